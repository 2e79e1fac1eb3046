// SPDX-License-Identifier: MIT
#include <fmt/format.h>

#include "framework/manual.h"
#include <map>
#include <set>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

// All data of the script is in tables of this form: key, then words.
std::string table(const std::string& name, const std::map<std::string, std::string>& rows) {
  std::string text = fmt::format("declare -gA {}=(\n", name);
  for (const auto& [key, words] : rows) text += fmt::format("  ['{}']='{}'\n", key, words);
  return text + ")\n";
}

void add_word(std::string& words, const std::string& word) {
  words += (words.empty() ? "" : " ") + word;
}

// The first lines of the script, followed by the tables and kFunctions.
constexpr const char* kHead = R"(# shellcheck shell=bash
# Completion of `tarsier` for bash. Made by `tarsier help --bash` from the program's own command line; do not edit.
# Words that may follow an area or verb, flags of a verb, and values of its flags; f: files, -: anything.
)";

constexpr const char* kFunctions = R"(
_tarsier() {
  local cur=${COMP_WORDS[COMP_CWORD]} previous='' path='' flag='' i word
  [ "$COMP_CWORD" -gt 0 ] && previous=${COMP_WORDS[COMP_CWORD-1]}
  # The line editor may cut --flag=value in three words.
  case $cur in
    =) cur='' flag=$previous ;;
    --*=*) flag=${cur%%=*} cur=${cur#*=} ;;
  esac
  if [ -z "$flag" ]; then
    if [ "$previous" = = ] && [ "$COMP_CWORD" -gt 1 ]; then
      flag=${COMP_WORDS[COMP_CWORD-2]}
    else
      case $previous in -?*) flag=$previous ;; esac
    fi
  fi
  for ((i = 1; i < COMP_CWORD; ++i)); do
    word=${COMP_WORDS[i]}
    case " ${_tarsier_words[${path:-.}]-} " in
      *" $word "*) path=${path:+$path }$word ;;
      *) break ;;
    esac
  done
  COMPREPLY=()
  # A word that is no area or verb where one must stand: nothing is known of what follows.
  [ "$i" -eq "$COMP_CWORD" ] || [ -z "${_tarsier_words[${path:-.}]-}" ] || return
  if [ -n "${_tarsier_words[${path:-.}]-}" ]; then
    case $cur in
      -*) mapfile -t COMPREPLY < <(compgen -W "--help${path:- --version}" -- "$cur") ;;
      *) mapfile -t COMPREPLY < <(compgen -W "${_tarsier_words[${path:-.}]}" -- "$cur") ;;
    esac
    return
  fi
  local values=''
  [ -n "$flag" ] && values=${_tarsier_values["$path $flag"]-${_tarsier_values[$flag]-}}
  case $values in
    '' | f)
      case $values$cur in
        -*)
          mapfile -t COMPREPLY < <(compgen -W "${_tarsier_flags[$path]} $_tarsier_common" -- "$cur")
          return
          ;;
      esac
      compopt -o filenames 2>/dev/null
      mapfile -t COMPREPLY < <(compgen -f -- "$cur")
      ;;
    -) ;; # a number or a text: nothing to offer
    *) mapfile -t COMPREPLY < <(compgen -W "$values" -- "$cur") ;;
  esac
}
complete -F _tarsier tarsier
)";

// The values of a flag: words, "f" for files, "-" if unknown; "" for a switch.
std::string values_of(const FlagInfo& flag) {
  if (flag.value.empty()) return {};
  std::string words;
  for (const std::string& choice : flag.choices) add_word(words, choice);
  if (!words.empty()) return words;
  return flag.value == "TEXT" || flag.value == "FILE" ? "f" : "-";
}

}  // namespace

std::string bash_completion(const std::vector<AreaInfo>& areas) {
  std::map<std::string, std::string> words, flags, values;
  std::set<std::string> common;
  for (const AreaInfo& area : areas) {
    add_word(words["."], area.name);
    for (const VerbInfo& verb : area.verbs) {
      std::string path = verb.path.front();
      for (size_t i = 1; i < verb.path.size(); ++i) {
        std::string& known = words[path];
        if ((' ' + known + ' ').find(' ' + verb.path[i] + ' ') == std::string::npos) {
          add_word(known, verb.path[i]);
        }
        path += ' ' + verb.path[i];
      }
      std::string& own = flags[path];
      for (const FlagInfo& flag : verb.flags) {
        if (flag.positional) continue;
        const bool shared = flag.group == "Common";
        for (const std::string& name : flag.names) {
          const std::string value = values_of(flag);
          if (!value.empty()) values[shared ? name : path + ' ' + name] = value;
          if (!name.starts_with("--")) continue;  // a short name needs no completion
          if (shared) {
            common.insert(name);
          } else {
            add_word(own, name);
          }
        }
      }
    }
  }
  std::string shared = "--help";
  for (const std::string& name : common) add_word(shared, name);
  return kHead + table("_tarsier_words", words) + table("_tarsier_flags", flags) +
         table("_tarsier_values", values) + fmt::format("_tarsier_common='{}'\n", shared) +
         kFunctions;
}

}  // namespace tarsier::cli
