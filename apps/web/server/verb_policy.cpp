// SPDX-License-Identifier: MIT
#include "verb_policy.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/words.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/http_protocol.h"

#include <fmt/format.h>

#include "verb_tables.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>

namespace tarsier::web {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMaxInputs = 1000;
constexpr std::size_t kMaxValues = 200;      // of a flag with several values
constexpr std::size_t kMaxText = 1000;       // bytes of a value
constexpr std::size_t kMaxReference = 1000;  // bytes

template <typename... Args>
[[noreturn]] void refuse(fmt::format_string<Args...> format, Args&&... args) {
  throw UsageError(fmt::format(format, std::forward<Args>(args)...));
}

bool is_among(const auto& names, std::string_view name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

bool begins_with_reference(std::string_view text) {
  for (const std::string_view scheme : {"set:", "job:", "ws:", "model:"}) {
    if (text.starts_with(scheme)) return true;
  }
  return false;
}

// A word that no verb can interpret as a path, an address or a list.
std::string checked_word(std::string_view flag, const std::string& text) {
  if (text.empty()) refuse("{} is empty: omit it, or give a value", flag);
  if (!is_one_line(text, kMaxText)) {
    refuse("{}: expected one line of at most {} bytes", flag, kMaxText);
  }
  if (text.find_first_of("/\\~") != std::string::npos || text.starts_with('@') ||
      text.starts_with('.') || text.find("..") != std::string::npos || text.starts_with("out:")) {
    refuse("{}: '{}' looks like a path; files are given as set:NAME/FILE, job:ID/FILE or ws:NAME",
           flag, text);
  }
  return text;
}

std::string checked_free_text(std::string_view flag, const std::string& text) {
  if (text.empty()) refuse("{} is empty: omit it, or give a text", flag);
  if (!is_one_line(text, kMaxText)) {
    refuse("{}: expected one line of at most {} bytes of UTF-8", flag, kMaxText);
  }
  return text;
}

std::string checked_synth(const std::string& text) {
  constexpr std::string_view kAllowed = "-_.,=&?:%+";
  const bool is_good = text.size() <= 300 && std::all_of(text.begin(), text.end(), [&](char c) {
                         return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                                (c >= '0' && c <= '9') || kAllowed.find(c) != std::string::npos;
                       });
  if (!is_good)
    refuse("'{}' is not a synthetic source; expected synth:NAME?key=value&key=value", text);
  return text;
}

std::string number_text(const Json& value) {
  if (value.is_number_integer()) return value.dump();
  return fmt::format("{}", value.get<double>());
}

// A JSON value as command-line text; not for switches.
std::string value_text(std::string_view name, const Json& value) {
  if (value.is_string()) return value.get<std::string>();
  if (value.is_number()) return number_text(value);
  refuse("{}: expected a text or a number", name);
}

void check_range(std::string_view name, const Json& range, double number) {
  if (!range.is_object()) return;
  const Json& low = range.at("min");
  const Json& high = range.at("max");
  const bool above = range.value("min_excluded", false);
  const bool is_low =
      low.is_number() && (above ? number <= low.get<double>() : number < low.get<double>());
  const bool below = range.value("max_excluded", false);
  const bool is_high =
      high.is_number() && (below ? number >= high.get<double>() : number > high.get<double>());
  if (!is_low && !is_high) return;
  const std::string from =
      low.is_number() ? fmt::format("{} {}", above ? "above" : "at least", low.dump()) : "";
  const std::string to =
      high.is_number() ? fmt::format("{} {}", below ? "below" : "at most", high.dump()) : "";
  refuse("{}: {} is out of range; expected {}{}{}", name, number, from,
         from.empty() || to.empty() ? "" : ", ", to);
}

// Checks one value against the flag's type, range and choices.
std::string checked_value(const Json& flag, std::string_view name, const Json& value) {
  const std::string type = flag.at("type");
  const std::string text = value_text(name, value);
  if (type == "text") {
    const Json& choices = flag.at("choices");
    if (!choices.empty() && std::find(choices.begin(), choices.end(), text) == choices.end()) {
      std::string known;
      for (const Json& choice : choices) {
        known += (known.empty() ? "" : ", ") + choice.get<std::string>();
      }
      refuse("{}: '{}' is not one of {}", name, text, known);
    }
    return checked_word(name, text);
  }
  const Json number = Json::parse(text, nullptr, false);
  const bool is_good = type == "integer" ? number.is_number_integer() : number.is_number();
  if (!is_good || !std::isfinite(number.get<double>())) {
    refuse("{}: expected {}, not '{}'", name, type == "integer" ? "a whole number" : "a number",
           text);
  }
  check_range(name, flag.at("range"), number.get<double>());
  return text;
}

// The texts in which a child may name the parts of a source's address, each with its replacement.
std::vector<std::pair<std::string, std::string>> secrets_of(const std::string& source,
                                                            const std::string& shown) {
  using Scheme = std::pair<std::string_view, std::uint16_t>;
  static constexpr auto kSchemes =  // with their ports
      std::to_array<Scheme>({{"http", 80}, {"https", 443}, {"rtsp", 554}, {"rtsps", 322}});
  std::vector<std::pair<std::string, std::string>> secrets{{source, shown},
                                                           {masked(source), shown}};
  const std::string name = lower_case(source.substr(0, source.find("://")));
  const auto* scheme = std::find_if(kSchemes.begin(), kSchemes.end(),
                                    [&](const Scheme& known) { return known.first == name; });
  if (scheme == kSchemes.end()) return secrets;
  HttpUrl url;
  try {
    url = parse_url(source, name, scheme->second);
  } catch (const InputError&) {  // the child reports it, too
    return secrets;
  }
  secrets.emplace_back(url.host_header(0), shown);
  // See connect_tcp().
  secrets.emplace_back(fmt::format("port {} of {}", url.port, url.host), shown);
  secrets.emplace_back(fmt::format("{} does not answer on port {}", url.host, url.port),
                       shown + " does not answer");
  secrets.emplace_back(fmt::format("'{}'", url.host), fmt::format("'{}'", shown));
  // A host of one word may also be a word of the output.
  if (url.host.find_first_of(".:") != std::string::npos &&
      shown.find(url.host) == std::string::npos) {
    secrets.emplace_back(url.host, shown);
  }
  return secrets;
}

class Builder {
 public:
  Builder(const Json& verb, const VerbRequest& request, Use use, const References& references)
      : verb_(verb), request_(request), use_(use), references_(references) {}

  CommandLine build() {
    for (const Json& word : verb_.at("path")) add(word.get<std::string>());
    add_flags();
    add_server_flags();
    add_inputs();
    if (use_ != Use::kLive) check_output();
    // The longest first: one may be a part of another.
    std::stable_sort(line_.secrets.begin(), line_.secrets.end(),
                     [](const auto& a, const auto& b) { return a.first.size() > b.first.size(); });
    for (const Audited& row : kAudited) {
      if (row.verb == request_.verb && (row.flag.empty() || has(row.flag))) line_.audit = row.event;
    }
    line_.shell_text = "tarsier";
    for (const std::string& word : shown_words_) line_.shell_text += ' ' + shell_quoted(word);
    return std::move(line_);
  }

 private:
  void add(const std::string& word) { add(word, word); }
  void add(const std::string& word, const std::string& shown_word) {
    line_.words.push_back(word);
    shown_words_.push_back(shown_word);
  }

  [[nodiscard]] bool has(std::string_view flag) const {
    return std::find(given_flags_.begin(), given_flags_.end(), flag) != given_flags_.end();
  }

  std::string input_file(std::string_view name, const std::string& reference) const {
    if (reference.size() > kMaxReference || !begins_with_reference(reference)) {
      refuse(
          "{}: '{}' is not a reference; files are given as set:NAME/FILE, job:ID/FILE or ws:NAME",
          name, reference.substr(0, 100));
    }
    return references_.file(reference, true);
  }

  std::string output_file(std::string_view name, const std::string& reference) {
    if (reference.starts_with("ws:")) {
      const std::string_view file = std::string_view(reference).substr(3);
      if (!is_good_name(file)) refuse("{}: '{}' is not a valid file name", name, file);
      if (is_among(kSharedState, file)) refuse("{}: ws:{} is reserved for other verbs", name, file);
      return references_.file(reference, false);
    }
    if (!reference.starts_with("out:")) {
      refuse("{}: '{}' is not an output; give out:NAME", name, reference.substr(0, 100));
    }
    const std::string file = reference.substr(4);
    if (!is_good_name(file)) {
      refuse(
          "{}: '{}' is not a valid file name: letters, digits, spaces, - _ . ( ), at most 120 "
          "bytes, no / and no . at its beginning",
          name, file);
    }
    if (use_ == Use::kLive || references_.output_folder.empty()) {
      refuse("{}: a live session makes no files; start a job, or give ws:NAME", name);
    }
    line_.outputs.push_back(file);
    return references_.output_folder + '/' + file;
  }

  std::string state_file(std::string_view name, const std::string& reference) const {
    if (!reference.starts_with("ws:")) {
      refuse("{}: '{}' is not a file of the workspace; give ws:NAME", name,
             reference.substr(0, 100));
    }
    return references_.file(reference, false);
  }

  std::string flag_text(const Json& flag, FlagKind kind, const std::string& name,
                        const Json& value) {
    switch (kind) {
      case FlagKind::kValue:
        return checked_value(flag, name, value);
      case FlagKind::kFreeText:
        return checked_free_text(name, value_text(name, value));
      case FlagKind::kInput:
        return input_file(name, value_text(name, value));
      case FlagKind::kWordOrInput: {
        const std::string text = value_text(name, value);
        return begins_with_reference(text) ? input_file(name, text) : checked_word(name, text);
      }
      case FlagKind::kOutput: {
        const std::string text = value_text(name, value);
        if (flag.at("headless_value") == text) return text;
        return output_file(name, text);
      }
      case FlagKind::kState:
        return state_file(name, value_text(name, value));
      case FlagKind::kServer:
      case FlagKind::kRefused:
      case FlagKind::kUnknown:
        break;
    }
    refuse("{} cannot be given here", name);
  }

  void add_switch(const Json& flag, const std::string& name, const Json& value) {
    if (!value.is_boolean()) refuse("{}: expected true or false", name);
    const Json& names = flag.at("names");
    if (value.get<bool>()) {
      add(name);
    } else if (const std::string off = "--no-" + name.substr(2);
               std::find(names.begin(), names.end(), off) != names.end()) {
      add(off);
    }
  }

  void add_flags() {
    if (!request_.flags.is_object()) refuse("flags: expected an object of flags and their values");
    for (const auto& [given, value] : request_.flags.items()) {
      const Json* flag = VerbTable::find_flag(verb_, given);
      if (flag == nullptr) refuse("'{}' has no flag '{}'", request_.verb, given.substr(0, 100));
      const std::string name = flag->at("names").front();
      const FlagKind kind = flag_kind(request_.verb, name);
      if (kind == FlagKind::kRefused || kind == FlagKind::kUnknown) {
        refuse("{} cannot be given from a page: {}", name,
               kind == FlagKind::kRefused ? "it reaches beyond the workspace"
                                          : "it is not listed as safe");
      }
      if (has(name)) refuse("{} is given twice, by two of its names", name);
      if (kind == FlagKind::kServer || value.is_null()) continue;
      if (flag->at("type") == "switch") {
        const bool is_off = given.starts_with("--no-") && given != name;
        add_switch(*flag, name, is_off && value.is_boolean() ? Json(!value.get<bool>()) : value);
      } else {
        add_values(*flag, kind, name, value);
      }
      given_flags_.push_back(name);
    }
  }

  void add_values(const Json& flag, FlagKind kind, const std::string& name, const Json& value) {
    const std::size_t value_count = flag.at("values");
    const bool repeatable = flag.at("repeatable");
    if (!value.is_array()) {
      if (value_count > 1) refuse("{}: expected a list of {} values", name, value_count);
      add(name + '=' + flag_text(flag, kind, name, value));
      return;
    }
    if (!repeatable && value.size() != value_count) {
      refuse("{}: expected {} value{}, not {}", name, value_count, value_count == 1 ? "" : "s",
             value.size());
    }
    if (value.empty() || value.size() > kMaxValues) {
      refuse("{}: expected 1 to {} values", name, kMaxValues);
    }
    if (repeatable) {
      for (const Json& item : value) add(name + '=' + flag_text(flag, kind, name, item));
      return;
    }
    for (std::size_t n = 0; n < value.size(); ++n) {
      const std::string text = flag_text(flag, kind, name, value[n]);
      if (n > 0 && text.starts_with('-')) refuse("{}: '{}' begins with '-'", name, text);
      add(n == 0 ? name + '=' + text : text);
    }
  }

  void add_server_flags() {
    const auto takes = [&](std::string_view name) {
      return VerbTable::find_flag(verb_, name) != nullptr &&
             flag_kind(request_.verb, name) == FlagKind::kServer;
    };
    for (const DefaultState& state : kDefaultStates) {
      if (VerbTable::find_flag(verb_, state.flag) != nullptr && !has(state.flag)) {
        add(fmt::format("{}={}", state.flag,
                        references_.file(std::string(state.reference), false)));
      }
    }
    if (use_ == Use::kLive) {
      if (!has_window(verb_)) refuse("'{}' cannot run live; start a job", request_.verb);
      add("--window");
    }
    // Without an output for its images such a verb would open a window.
    const Json* output = VerbTable::find_flag(verb_, "--output");
    if (use_ != Use::kLive && output != nullptr && !has("--output") &&
        output->at("headless_value").is_string()) {
      add("--output=" + output->at("headless_value").get<std::string>());
    }
    if (takes("--json")) add("--json");
    if (use_ == Use::kJob && takes("--progress")) add("--progress=json");
    if (takes("--yes")) add("--yes");  // the page has asked the user
  }

  // Refuses a run or a job that would open a window.
  void check_output() const {
    const auto flags = verb_.find("needs_output");
    if (flags == verb_.end()) return;
    std::string names;
    for (const Json& item : *flags) {
      const std::string flag = item;
      if (has(flag)) return;
      names += fmt::format("{}{}", names.empty() ? "" : " or ", flag);
    }
    if (names.empty()) {
      refuse("'{}' works only in a window; start a live session instead", request_.verb);
    }
    refuse(
        "{}: expected the name of an image file, such as out:image.png; without it '{}' opens a "
        "window, which only a live session has",
        names, request_.verb);
  }

  void add_inputs() {
    const Json& takes = verb_.at("inputs");
    const std::vector<std::string>& given = request_.inputs;
    if (given.size() > kMaxInputs)
      refuse("{} inputs are too many; give a set instead", given.size());
    add("--");
    std::size_t next = 0;
    for (std::size_t n = 0; n < takes.size(); ++n) {
      const std::string name = takes[n].at("names").front();
      if (next == given.size()) {
        if (takes[n].at("required").get<bool>()) refuse("'{}' needs {}", request_.verb, name);
        break;
      }
      do {
        add_input(name, given[next++]);
      } while (takes[n].at("repeatable").get<bool>() && next < given.size());
    }
    if (next < given.size()) {
      refuse("'{}' takes {} input{}, not {}", request_.verb, next, next == 1 ? "" : "s",
             given.size());
    }
    if (given.empty()) {  // no "--" without inputs
      line_.words.pop_back();
      shown_words_.pop_back();
    }
  }

  void add_input(const std::string& name, const std::string& text) {
    switch (input_kind(request_.verb, name)) {
      case InputKind::kFreeText:
        return add(checked_free_text(name, text));
      case InputKind::kValue:
        return add(checked_word(name, text));
      case InputKind::kState:
        return add(state_file(name, text));
      case InputKind::kSource:
        if (text.starts_with("synth:")) return add(checked_synth(text));
        if (text.starts_with("camera:") || text.starts_with("allowed:") ||
            text.starts_with("viewer:")) {
          return add_source(text);
        }
        return add(input_file(name, text));
      case InputKind::kFile:
        return add(input_file(name, text));
      case InputKind::kUnknown:
        break;
    }
    refuse("'{}': its input {} cannot be given from a page", request_.verb, name);
  }

  void add_source(const std::string& text) {
    if (!is_one_line(text, kMaxReference)) refuse("the name of a source must be one line");
    const std::string word = references_.source(text);
    const bool is_secret = text.starts_with("allowed:");
    if (is_secret) {
      auto secrets = secrets_of(word, text);
      std::move(secrets.begin(), secrets.end(), std::back_inserter(line_.secrets));
    }
    add(word, is_secret ? text : word);
  }

  const Json& verb_;
  const VerbRequest& request_;
  const Use use_;
  const References& references_;
  CommandLine line_;
  std::vector<std::string> shown_words_;
  std::vector<std::string> given_flags_;
};

}  // namespace

bool is_refused_verb(std::string_view verb) { return is_among(kRefusedVerbs, verb); }

FlagKind flag_kind(std::string_view verb, std::string_view flag) {
  for (const FlagException& row : kFlagExceptions) {
    if (row.verb == verb && row.flag == flag) return row.kind;
  }
  if (is_among(kRefusedFlags, flag)) return FlagKind::kRefused;
  if (is_among(kServerFlags, flag)) return FlagKind::kServer;
  if (is_among(kValueFlags, flag)) return FlagKind::kValue;
  if (is_among(kFreeTextFlags, flag)) return FlagKind::kFreeText;
  if (is_among(kInputFlags, flag)) return FlagKind::kInput;
  if (is_among(kWordOrInputFlags, flag)) return FlagKind::kWordOrInput;
  if (is_among(kOutputFlags, flag)) return FlagKind::kOutput;
  if (is_among(kStateFlags, flag)) return FlagKind::kState;
  return FlagKind::kUnknown;
}

InputKind input_kind(std::string_view verb, std::string_view input) {
  for (const InputException& row : kInputExceptions) {
    if (row.verb == verb && row.input == input) return row.kind;
  }
  if ((input == "INPUT" || input == "PHOTOS") && is_among(kSourceInputs, verb)) {
    return InputKind::kSource;
  }
  return is_among(kFileInputs, input) ? InputKind::kFile : InputKind::kUnknown;
}

VerbTable::VerbTable(const std::string& help_json) {
  help_ = Json::parse(help_json, nullptr, false);
  if (!help_.is_object() || !help_.contains("verbs") || !help_["verbs"].is_array()) {
    throw InputError("tarsier help --json", "did not return the expected object");
  }
  for (Json& entry : help_["verbs"]) {
    for (const WindowVerb& row : kWindowVerbs) {
      if (entry.at("verb").get_ref<const std::string&>() != row.verb) continue;
      Json& flags = entry["needs_output"] = Json::array();
      for (const std::string_view flag : row.outputs) {
        if (!flag.empty()) flags.push_back(flag);
      }
    }
  }
  text_ = help_.dump();
}

const Json* VerbTable::find(std::string_view verb) const {
  if (!help_.contains("verbs")) return nullptr;
  for (const Json& entry : help_["verbs"]) {
    if (entry.at("verb").get_ref<const std::string&>() == verb) return &entry;
  }
  return nullptr;
}

const Json* VerbTable::find_flag(const Json& verb, std::string_view name) {
  for (const Json& flag : verb.at("flags")) {
    for (const Json& known : flag.at("names")) {
      if (known.get_ref<const std::string&>() == name) return &flag;
    }
  }
  return nullptr;
}

bool has_window(const Json& verb) {
  const Json* flag = VerbTable::find_flag(verb, "--window");
  return flag != nullptr && flag->at("type") == "switch";
}

VerbRequest verb_request(const Json& object) {
  VerbRequest request;
  if (!object.is_object()) refuse("expected an object: verb, inputs, flags");
  const auto verb = object.find("verb");
  if (verb == object.end() || !verb->is_string()) refuse("verb: expected a text like 'plate read'");
  request.verb = verb->get<std::string>();
  if (const auto inputs = object.find("inputs"); inputs != object.end() && !inputs->is_null()) {
    if (!inputs->is_array()) refuse("inputs: expected a list of texts");
    for (const Json& input : *inputs) {
      if (!input.is_string()) refuse("inputs: expected a list of texts");
      request.inputs.push_back(input.get<std::string>());
    }
  }
  if (const auto flags = object.find("flags"); flags != object.end() && !flags->is_null()) {
    if (!flags->is_object()) refuse("flags: expected an object of flags and their values");
    request.flags = *flags;
  }
  return request;
}

CommandLine command_line(const VerbTable& verbs, const VerbRequest& request, Use use,
                         const References& references) {
  const Json* verb = verbs.find(request.verb);
  if (verb == nullptr) {
    refuse("no verb '{}'; /api/help lists them all", request.verb.substr(0, 100));
  }
  if (is_refused_verb(request.verb)) refuse("'{}' cannot be started from a page", request.verb);
  return Builder(*verb, request, use, references).build();
}

std::string without_secrets(std::string text,
                            const std::vector<std::pair<std::string, std::string>>& secrets) {
  for (const auto& [secret, shown] : secrets) {
    if (secret.empty()) continue;
    for (std::size_t at = text.find(secret); at != std::string::npos;
         at = text.find(secret, at + shown.size()))
      text.replace(at, secret.size(), shown);
  }
  return text;
}

std::string shell_quoted(std::string_view word) {
  constexpr std::string_view kPlain = "-_./:=,+@%";
  const bool is_plain = !word.empty() && std::all_of(word.begin(), word.end(), [&](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
           kPlain.find(c) != std::string_view::npos;
  });
  if (is_plain) return std::string(word);
  std::string quoted = "'";
  for (const char c : word) {
    if (c == '\'') {
      quoted += "'\\''";
    } else {
      quoted += c;
    }
  }
  return quoted + '\'';
}

bool is_one_line(std::string_view text, std::size_t max_bytes) {
  if (text.size() > max_bytes) return false;
  for (std::size_t n = 0; n < text.size();) {
    const auto byte = static_cast<unsigned char>(text[n]);
    if (byte < 0x20 || byte == 0x7f) return false;
    const std::size_t length = byte < 0x80   ? 1
                               : byte < 0xc2 ? 0
                               : byte < 0xe0 ? 2
                               : byte < 0xf0 ? 3
                               : byte < 0xf5 ? 4
                                             : 0;
    if (length == 0 || n + length > text.size()) return false;
    std::uint32_t code = length == 1 ? byte : byte & (0xffU >> (length + 1));
    for (std::size_t k = 1; k < length; ++k) {
      const auto next = static_cast<unsigned char>(text[n + k]);
      if ((next & 0xc0U) != 0x80) return false;
      code = (code << 6U) | (next & 0x3fU);
    }
    constexpr std::array<std::uint32_t, 5> kMinCode = {0, 0, 0x80, 0x800, 0x10000};
    if (code < kMinCode[length] || code > 0x10ffff || (code >= 0xd800 && code < 0xe000))
      return false;
    if (code >= 0x80 && code < 0xa0) return false;  // control characters, too
    // Line separators, and characters that change the direction of text.
    if (code == 0x2028 || code == 0x2029 || (code >= 0x202a && code <= 0x202e) ||
        (code >= 0x2066 && code <= 0x2069)) {
      return false;
    }
    n += length;
  }
  return true;
}

bool is_good_name(std::string_view name) {
  return !name.empty() && is_one_line(name, 120) && name.front() != '.' && name.front() != ' ' &&
         name.back() != ' ' && name.find_first_of("/\\*?[]") == std::string_view::npos;
}

}  // namespace tarsier::web
