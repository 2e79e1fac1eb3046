// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

// Decides what a page may start. A request names a verb, its inputs and its flags; the result is
// the words of a command line, which never passes through a shell. Only entries of verb_tables.h
// are accepted: an unclassified verb, flag or input is refused.
namespace tarsier::web {

// The meaning of a flag's value for a page.
enum class FlagKind {
  kUnknown,   // in no table: refused
  kValue,     // a number, a switch, a choice, a word; never a path
  kFreeText,  // any text of one line: names, notes, search text
  kInput,     // an existing file or folder: set:, job:, ws:, model:
  // A word ("auto", "none", "500,500,320,240"), or an existing file.
  kWordOrInput,
  kOutput,  // a new file or folder: out:NAME, or ws:NAME
  kState,   // a permanent file of the workspace: ws:gallery
  kServer,  // set by the server itself; ignored from a page
  // Never from a page: runs programs, opens the network, reads any file.
  kRefused,
};

// The meaning of a positional input for a page.
enum class InputKind { kUnknown, kSource, kFile, kState, kValue, kFreeText };

// Verbs that no page may start.
[[nodiscard]] bool is_refused_verb(std::string_view verb);

[[nodiscard]] FlagKind flag_kind(std::string_view verb, std::string_view flag);
[[nodiscard]] InputKind input_kind(std::string_view verb, std::string_view input);

// How a verb is started.
enum class Use {
  // A session with a window in the browser; writes only files of the workspace.
  kLive,
  kJob,  // long work; its files are in the job's folder
  kRun,  // a quick request; otherwise as a job
};

// The object of `tarsier help --json`. Each verb that opens a window unless it writes a file has
// the additional field `needs_output`: the flags of which a run or a job must have one. If that
// list is empty, the verb works only in a window.
class VerbTable {
 public:
  VerbTable() = default;
  // Throws InputError if the text is not such an object.
  explicit VerbTable(const std::string& help_json);
  // The entry of "plate read", or nullptr.
  [[nodiscard]] const nlohmann::json* find(std::string_view verb) const;
  // The entry of the flag with one of its names, or nullptr.
  [[nodiscard]] static const nlohmann::json* find_flag(const nlohmann::json& verb,
                                                       std::string_view name);
  [[nodiscard]] const nlohmann::json& json() const { return help_; }
  // json() as text, for GET /api/help.
  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  nlohmann::json help_ = nlohmann::json::object();
  std::string text_;
};

// Whether the verb can run live: it has a switch --window.
[[nodiscard]] bool has_window(const nlohmann::json& verb);

// Resolves references. Both functions throw UsageError in plain words.
struct References {
  // The path of "set:NAME", "set:NAME/FILE", "job:ID/PATH", "ws:NAME", "model:NAME". If
  // `must_exist` is false it may be new (only "ws:").
  std::function<std::string(const std::string& reference, bool must_exist)> file;
  // The source for "camera:0", "allowed:NAME", "viewer:ID"; synth: is checked here.
  std::function<std::string(const std::string& reference)> source;
  // Folder for out:NAME; empty: no output is allowed.
  std::string output_folder;
};

struct VerbRequest {
  std::string verb;                                 // "plate read"
  std::vector<std::string> inputs;                  // in the verb's order
  nlohmann::json flags = nlohmann::json::object();  // {"--mode": "sketch", "--steady": true}
};
// Parses {"verb","inputs","flags"}. Throws UsageError.
[[nodiscard]] VerbRequest verb_request(const nlohmann::json& object);

struct CommandLine {
  std::vector<std::string> words;  // after the program's path
  // For people: quoted for a shell; sources on other machines only by name.
  std::string shell_text;
  std::vector<std::string> outputs;  // names of out:NAME, in order
  // Texts that must not be shown (addresses of sources and their parts), and the replacement of
  // each; the longest first.
  std::vector<std::pair<std::string, std::string>> secrets;
  // The audit event, or "": "enrol", "forget", "export", "delete".
  std::string audit;
};

// Throws UsageError, one plain line: unknown verb or flag; a value of the wrong type, out of range
// or not among the choices; a path instead of a reference; an output in a live session; a run or a
// job that would open a window.
[[nodiscard]] CommandLine command_line(const VerbTable& verbs, const VerbRequest& request, Use use,
                                       const References& references);

// Replaces each of CommandLine::secrets in `text`.
[[nodiscard]] std::string without_secrets(
    std::string text, const std::vector<std::pair<std::string, std::string>>& secrets);

// Quotes one word for a POSIX shell.
[[nodiscard]] std::string shell_quoted(std::string_view word);

// Names of sets, files and outputs: UTF-8 of 1..120 bytes, without '/', '\', control characters or
// glob characters (* ? [ ]), without a leading '.', without spaces at the ends.
[[nodiscard]] bool is_good_name(std::string_view name);
// Valid UTF-8 without control characters, at most `max_bytes`.
[[nodiscard]] bool is_one_line(std::string_view text, std::size_t max_bytes);

}  // namespace tarsier::web
