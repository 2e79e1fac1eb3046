// SPDX-License-Identifier: MIT
// Requests of browsers and programs to the studio: verbs, files; and the output of jobs.
#include "tarsier/core/errors.h"

#include "fuzz.h"
#include "jobs.h"
#include "verb_policy.h"
#include "workspace.h"
#include <algorithm>
#include <nlohmann/json.hpp>

namespace tarsier::fuzz {
namespace {

// Verbs with a flag and an input of each kind, in the format of `help --json`.
constexpr std::string_view kVerbs = R"({"verbs":[
{"verb":"pose track","path":["pose","track"],"area":"pose","inputs":[{"names":["INPUT"],"required":true,"repeatable":true}],
 "flags":[{"names":["--output","-o"],"type":"text","choices":[],"headless_value":"none","range":null,"values":1,"repeatable":false,"help":"none; without it: the window"},
  {"names":["--draw"],"type":"text","choices":[],"headless_value":null,"range":null,"values":1,"repeatable":false,"help":""},
  {"names":["--smooth"],"type":"text","choices":["none","mean"],"headless_value":null,"range":null,"values":1,"repeatable":false,"help":""},
  {"names":["--every"],"type":"integer","choices":[],"headless_value":null,"range":{"min":0,"max":null,"min_excluded":true},"values":1,"repeatable":false,"help":""},
  {"names":["--fps"],"type":"number","choices":[],"headless_value":null,"range":null,"values":1,"repeatable":false,"help":""},
  {"names":["--pepper","--no-pepper"],"type":"switch","choices":[],"headless_value":null,"range":null,"values":0,"repeatable":false,"help":""},
  {"names":["--window"],"type":"switch","choices":[],"headless_value":null,"range":null,"values":0,"repeatable":false,"help":""},
  {"names":["--eyes"],"type":"integer","choices":[],"headless_value":null,"range":null,"values":2,"repeatable":false,"help":""},
  {"names":["--target"],"type":"text","choices":[],"headless_value":null,"range":null,"values":1,"repeatable":true,"help":""},
  {"names":["--on-event"],"type":"text","choices":[],"headless_value":null,"range":null,"values":1,"repeatable":false,"help":""}]},
{"verb":"people enroll","path":["people","enroll"],"area":"people",
 "inputs":[{"names":["NAME"],"required":true,"repeatable":false},{"names":["INPUT"],"required":true,"repeatable":true}],
 "flags":[{"names":["--gallery"],"type":"text","choices":[],"headless_value":null,"range":null,"values":1,"repeatable":false,"help":""},
  {"names":["--note"],"type":"text","choices":[],"headless_value":null,"range":null,"values":1,"repeatable":false,"help":""},
  {"names":["--json"],"type":"switch","choices":[],"headless_value":null,"range":null,"values":0,"repeatable":false,"help":""}]}]})";

// A path that was taken from a page's words would not begin with this.
constexpr std::string_view kWorkspace = "/workspace/";

bool is_ours(std::string_view value) {
  return !value.starts_with('/') || value.starts_with(kWorkspace);
}

}  // namespace

TARSIER_FUZZ_TARGET(verb_request, kJson) {
  static const web::VerbTable verbs{std::string(kVerbs)};
  const web::References references{
      [](const std::string&, bool) { return std::string(kWorkspace) + "file"; },
      [](const std::string&) { return std::string("0"); }, std::string(kWorkspace) + "files"};
  const auto json = nlohmann::json::parse(text_of(input), nullptr, false);
  if (json.is_discarded()) throw UsageError("no JSON");
  const web::VerbRequest request = web::verb_request(json);
  for (const web::Use use : {web::Use::kLive, web::Use::kJob}) {
    const web::CommandLine line = web::command_line(verbs, request, use, references);
    const auto dashes = std::find(line.words.begin(), line.words.end(), "--");
    for (auto word = line.words.begin(); word != dashes; ++word) {
      const std::size_t equals = std::min(word->find('='), word->size());
      const std::string name = word->substr(0, equals);
      expect(name != "--on-event", "a program is run");
      const bool is_free = name == "--note";
      if (equals < word->size())
        expect(is_free || is_ours(word->substr(equals + 1)), "a path of a page");
    }
    const bool has_name = request.verb == "people enroll";
    for (auto word = dashes; word != line.words.end(); ++word) {
      const bool is_free = has_name && word == dashes + 1;
      expect(is_free || is_ours(*word), "an input of a page");
    }
    for (const std::string& word : line.words) {
      expect(word.find('\0') == std::string::npos && word.find('\n') == std::string::npos,
             "a word of several lines");
    }
  }
}

TARSIER_FUZZ_TARGET(upload, kBytes) {
  web::FileType type{};
  for (const char* name : {"a.jpg", "a.mp4", "a.json", "a"}) {
    (void)web::upload_error(name, text_of(input), 1'000'000, type);
  }
}

TARSIER_FUZZ_TARGET(job_message, kBytes) {
  const auto progress = web::progress_of(text_of(input));
  if (!progress) throw UsageError("no progress");
  expect((*progress)["label"].is_string(), "progress without its name");
}

}  // namespace tarsier::fuzz
