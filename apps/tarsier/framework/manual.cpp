// SPDX-License-Identifier: MIT
#include "framework/manual.h"

#include <fmt/format.h>

#include "framework/cli.h"
#include <string_view>

namespace tarsier::cli {
namespace {

constexpr const char* kInputs =
    R"(An input is an image, a folder, a glob (quoted), \fB@list.txt\fR (one path a line), a video, a camera number or
path, \fBpicam:\fR (a Raspberry Pi's camera module), an http(s) or rtsp URL, or \fBsynth:scene\fR (drawn by the
program). Several may follow each other. Still images are independent of each other unless \fB\-\-sequence\fR
is given.
)";

constexpr const char* kExitStatus = R"(.TP
.B 0
done
.TP
.B 1
done, but nothing was found
.TP
.B 2
usage: the command line is wrong
.TP
.B 3
bad input, also a source that never opens and a missing display
.TP
.B 4
a source was lost after its first frame
.TP
.B 5
a model is missing or broken
.TP
.B 6
the output cannot be written
.TP
.B 130
interrupted; what was finished stays
)";

constexpr const char* kEnvironment = R"(.TP
.B TARSIER_MODELS
folder of the models, in place of the one that came with the program
.TP
.B TARSIER_OWN_MODELS
folder of models of your own, each taken in place of the one of its name (tarsier models install)
.TP
.B TARSIER_CASCADES
folder of OpenCV's cascade files, searched first
.TP
.B TARSIER_SIMD
the widest vector instructions that may be used: baseline, sse4.1 or avx2
.TP
.B NO_COLOR
if set,
.B tarsier doctor
prints no colours
)";

// Escapes text for roff: no control characters, no lines that begin a request.
std::string roff(std::string_view text) {
  std::string result;
  for (const char c : text) {
    if (c == '\\') {
      result += "\\e";
    } else if (c == '-') {
      result += "\\-";
    } else if (c == '~') {
      result += "\\(ti";
    } else if (c == '^') {
      result += "\\(ha";
    } else if (c == '`') {
      result += "\\(ga";
    } else if (c == '\'') {
      result += "\\(aq";
    } else if (c == '"') {
      result += "\\(dq";
    } else {
      result += c == '\n' ? ' ' : c;
    }
  }
  return result.starts_with('.') ? "\\&" + result : result;
}

std::string upper_case(std::string text) {
  for (char& c : text) c = static_cast<char>(c >= 'a' && c <= 'z' ? c - 'a' + 'A' : c);
  return text;
}

std::string bold(std::string_view text) { return "\\fB" + roff(text) + "\\fR"; }
std::string italic(std::string_view text) { return "\\fI" + roff(text) + "\\fR"; }

std::string header(const std::string& page, const std::string& date, std::string_view what) {
  return fmt::format(
      ".\\\" Made by `tarsier help --man` from the program's own command line; do not edit.\n"
      ".TH {} 1 {} \"tarsier {}\" \"User Commands\"\n.SH NAME\n{} \\- {}\n",
      roff(upper_case(page)), date, version(), roff(page), roff(what));
}

std::string value_text(const FlagInfo& flag) {
  if (flag.value.empty()) return {};
  std::string text = italic(flag.value);
  if (!flag.choices.empty()) {
    text = "{";
    for (const std::string& choice : flag.choices) {
      if (text.size() > 1) text += ',';
      text += bold(choice);
    }
    text += '}';
  }
  return flag.many ? text + " ..." : text;
}

std::string flag_text(const FlagInfo& flag) {
  std::string names;
  for (auto name = flag.names.rbegin(); name != flag.names.rend(); ++name) {  // -o, --output
    names += (names.empty() ? "" : ", ") + bold(*name);
  }
  if (flag.positional) names = italic(flag.names.front()) + (flag.many ? " ..." : "");
  const std::string value = flag.positional ? std::string() : value_text(flag);
  std::string notes;
  if (flag.required) notes += "; required";
  if (flag.range) notes += "; " + roff(flag.range->text());
  if (!flag.default_value.empty()) notes += "; default " + bold(flag.default_value);
  std::string body = roff(flag.description);
  if (!notes.empty()) body += (body.empty() ? "(" : " (") + notes.substr(2) + ')';
  // \& prevents a description that begins with a dot, or is empty, from being read as a request.
  return fmt::format(".TP\n{}{}{}\n{}\n", names, value.empty() ? "" : " ", value,
                     body.empty() ? "\\&" : body);
}

bool is_common(const FlagInfo& flag) { return flag.group == "Common"; }

std::string verb_section(const VerbInfo& verb) {
  std::string words;
  for (const std::string& word : verb.path) words += (words.empty() ? "" : " ") + word;
  std::string text = fmt::format(".SH \"TARSIER {}\"\n", roff(upper_case(words)));
  text += roff(verb.description) + ".\n";
  if (!verb.example.empty())
    text += ".PP\nExample:\n.PP\n.RS\n.EX\n" + roff(verb.example) + "\n.EE\n.RE\n";
  std::string group;
  for (const FlagInfo& flag : verb.flags) {
    if (is_common(flag)) continue;
    if (flag.group != group && !flag.positional) {
      group = flag.group;
      if (group != "Options" && group != "OPTIONS") text += ".SS " + roff(group) + '\n';
    }
    text += flag_text(flag);
  }
  return text;
}

ManualFile area_page(const AreaInfo& area, const std::string& date) {
  const std::string page = "tarsier-" + area.name;
  std::string text = header(page, date, area.description);
  text += ".SH SYNOPSIS\n.nf\n";
  for (const VerbInfo& verb : area.verbs) {
    const size_t options = verb.usage.find(" [OPTIONS]");
    text += bold(verb.usage.substr(0, options)) + " [" + italic("OPTIONS") + ']' +
            roff(verb.usage.substr(options + 10)) + '\n';
  }
  text += ".fi\n";
  for (const VerbInfo& verb : area.verbs) text += verb_section(verb);
  text += ".SH \"COMMON FLAGS\"\nAll verbs have these.\n";
  for (const FlagInfo& flag : area.verbs.front().flags) {
    if (is_common(flag)) text += flag_text(flag);
  }
  text += std::string(".SH \"EXIT STATUS\"\n") + kExitStatus;
  text += ".SH \"SEE ALSO\"\n.BR tarsier (1)\n";
  return {page + ".1", text};
}

ManualFile main_page(const std::vector<AreaInfo>& areas, const std::string& date) {
  std::string text = header("tarsier", date, "classical computer vision on an ordinary CPU");
  text +=
      ".SH SYNOPSIS\n.B tarsier\n.I area verb\n.RI [ inputs ]\n.RI [ flags ]\n.SH DESCRIPTION\n"
      "Tarsier turns cameras into cartoons, rebuilds scenes from images, reads number plates, "
      "finds and\n"
      "follows the points of faces, fits appearance models, tells where heads look, recognises "
      "people and\n"
      "calibrates cameras; all of it offline and without a GPU. Each area has a page of its own.\n"
      ".SH AREAS\n";
  for (const AreaInfo& area : areas) {
    text += fmt::format(".TP\n.BR tarsier\\-{} (1)\n{}\n", roff(area.name), roff(area.description));
  }
  text += std::string(".SH INPUTS\n") + kInputs;
  text += ".SH EXAMPLES\n";
  for (const AreaInfo& area : areas) {
    const VerbInfo& verb = area.verbs.front();
    if (verb.example.empty() || area.name == "bench") continue;
    text += fmt::format(".TP\n{}\n{}\n", bold(verb.example), roff(verb.description));
  }
  text += ".SH \"COMMON FLAGS\"\n";
  for (const FlagInfo& flag : areas.front().verbs.front().flags) {
    if (is_common(flag)) text += flag_text(flag);
  }
  text += std::string(".SH \"EXIT STATUS\"\n") + kExitStatus;
  text += std::string(".SH ENVIRONMENT\n") + kEnvironment;
  text +=
      ".SH FILES\n.TP\n.I /usr/share/tarsier/models\nthe models that came with the program, each "
      "with a card "
      "that tells its data, terms\nand measured accuracy (package tarsier\\-models)\n.SH \"SEE "
      "ALSO\"\n";
  for (size_t i = 0; i < areas.size(); ++i) {
    text += fmt::format(".BR tarsier\\-{} (1){}\n", roff(areas[i].name),
                        i + 1 < areas.size() ? "," : "");
  }
  return {"tarsier.1", text};
}

}  // namespace

std::vector<ManualFile> manual_pages(const std::vector<AreaInfo>& areas, const std::string& date) {
  std::vector<ManualFile> pages = {main_page(areas, date)};
  for (const AreaInfo& area : areas) pages.push_back(area_page(area, date));
  return pages;
}

}  // namespace tarsier::cli
