// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

// What a page may start. A request names a verb, its inputs and its flags; what comes out is the
// words of a command line, which no shell ever sees. Nothing is passed on that is not in the tables
// of verb_tables.h: a verb, flag or input that nobody has classified is refused.
namespace tarsier::web {

// What the value of a flag means to a page.
enum class FlagKind {
  kUnknown,      // in no table: refused
  kValue,        // a number, a switch, one of the choices, a word; never a path
  kFreeText,     // any text of one line: names, notes, what is searched
  kInput,        // a file or folder that is there: set:, job:, ws:, model:
  kWordOrInput,  // a word ("auto", "none", "500,500,320,240"), or such a file
  kOutput,       // a file or folder that is made: out:NAME, or ws:NAME
  kState,        // a file of the workspace that stays: ws:gallery
  kServer,       // set by the server itself; from a page it is taken and left out
  kRefused,      // never from a page: runs programs, opens the network, reads any file
};

// What an input without a flag's name means to a page.
enum class InputKind { kUnknown, kSource, kFile, kState, kValue, kFreeText };

// Verbs that no page may start at all.
[[nodiscard]] bool is_refused_verb(std::string_view verb);

[[nodiscard]] FlagKind flag_kind(std::string_view verb, std::string_view flag);
[[nodiscard]] InputKind input_kind(std::string_view verb, std::string_view input);

// How a verb is started.
enum class Use {
  kLive,  // a session with a window in the browser; makes no files but those of the workspace
  kJob,   // long work; files go below its folder
  kRun,   // a quick question; as a job
};

// The object of `tarsier help --json`, indexed.
class VerbTable {
 public:
  VerbTable() = default;
  // Throws InputError where the text is not that object.
  explicit VerbTable(const std::string& help_json);
  // The entry of "plate read", or nullptr.
  [[nodiscard]] const nlohmann::json* find(std::string_view verb) const;
  // The entry of the flag with one of its names, or nullptr.
  [[nodiscard]] static const nlohmann::json* find_flag(const nlohmann::json& verb,
                                                       std::string_view name);
  [[nodiscard]] const nlohmann::json& json() const { return help_; }
  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  nlohmann::json help_ = nlohmann::json::object();
  std::string text_;
};

// Whether the verb has a live form: a flag --window that is a switch.
[[nodiscard]] bool has_window(const nlohmann::json& verb);

// What references stand for. Both throw UsageError in plain words.
struct References {
  // The path of "set:NAME", "set:NAME/FILE", "job:ID/PATH", "ws:NAME", "model:NAME". Where
  // `must_exist` is false it may be new ("ws:" only).
  std::function<std::string(const std::string& reference, bool must_exist)> file;
  // The word for "camera:0", "allowed:NAME", "viewer:ID"; synth: is checked here.
  std::function<std::string(const std::string& reference)> source;
  // Where out:NAME goes; empty: nothing may be made.
  std::string output_folder;
};

struct VerbRequest {
  std::string verb;                                 // "plate read"
  std::vector<std::string> inputs;                  // in the verb's order
  nlohmann::json flags = nlohmann::json::object();  // {"--mode": "sketch", "--steady": true}
};
// From {"verb","inputs","flags"}. Throws UsageError.
[[nodiscard]] VerbRequest verb_request(const nlohmann::json& object);

struct CommandLine {
  std::vector<std::string> words;    // behind the program's path
  std::string shown;                 // for people: quoted for a shell, sources of other machines
                                     // by their names alone
  std::vector<std::string> outputs;  // names of out:NAME, in their order
  // Texts that must not be seen (URLs with their passwords), and what stands for each.
  std::vector<std::pair<std::string, std::string>> secrets;
  // What the audit log tells of it, or "": "enrol", "forget", "export", "delete".
  std::string audit;
};

// Throws UsageError, one plain line: no such verb or flag, a value of the wrong type, outside its
// range, not among the choices; a path where a reference belongs; an output in a live session.
[[nodiscard]] CommandLine command_line(const VerbTable& verbs, const VerbRequest& request, Use use,
                                       const References& references);

// One word for a POSIX shell.
[[nodiscard]] std::string shell_quoted(std::string_view word);

// Names of sets, files and outputs: UTF-8 of 1..120 bytes, no '/', '\', control characters or
// characters of globs (* ? [ ]), not '.' at its beginning, no space at either end.
[[nodiscard]] bool is_good_name(std::string_view name);
// Valid UTF-8 without control characters, at most `max_bytes`.
[[nodiscard]] bool is_one_line(std::string_view text, std::size_t max_bytes);

}  // namespace tarsier::web
