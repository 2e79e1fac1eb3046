// SPDX-License-Identifier: MIT
#include "verb_policy.h"

#include "tarsier/core/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "verb_tables.h"
#include <algorithm>
#include <array>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

namespace tarsier::web {
namespace {

using Json = nlohmann::json;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

// The real program's own command line.
const VerbTable& real_verbs() {
  static const VerbTable verbs = [] {
    std::string text;
    std::FILE* pipe = ::popen("'" TARSIER_PROGRAM "' help --json", "r");
    std::array<char, 65536> buffer{};
    while (const std::size_t count = std::fread(buffer.data(), 1, buffer.size(), pipe)) {
      text.append(buffer.data(), count);
    }
    ::pclose(pipe);
    return VerbTable(text);
  }();
  return verbs;
}

References some_references(const std::string& outputs = "/w/jobs/j1/files") {
  return {[](const std::string& reference, bool) {
            return "/w/" + reference.substr(reference.find(':') + 1);
          },
          [](const std::string& reference) {
            return reference.starts_with("camera:") ? reference.substr(7)
                                                    : "http://user:secret@cam/" + reference;
          },
          outputs};
}

CommandLine line_of(const std::string& verb, const std::vector<std::string>& inputs,
                    const Json& flags = Json::object(), Use use = Use::kRun) {
  return command_line(real_verbs(), {verb, inputs, flags}, use, some_references());
}

std::string refusal(const std::string& verb, const std::vector<std::string>& inputs,
                    const Json& flags = Json::object(), Use use = Use::kRun) {
  try {
    const CommandLine line = line_of(verb, inputs, flags, use);
    return "taken: " + line.shell_text;
  } catch (const UsageError& error) {
    return error.what();
  }
}

TEST(VerbPolicy, KnowsEachFlagOfEachVerb) {
  ASSERT_GT(real_verbs().json()["verbs"].size(), 60U);
  for (const Json& verb : real_verbs().json()["verbs"]) {
    const std::string name = verb["verb"];
    if (is_refused_verb(name)) continue;
    for (const Json& flag : verb["flags"]) {
      EXPECT_NE(flag_kind(name, flag["names"][0].get<std::string>()), FlagKind::kUnknown)
          << name << ' ' << flag["names"][0] << ": say in verb_tables.h what its value is ("
          << flag["help"] << ")";
    }
    for (const Json& input : verb["inputs"]) {
      EXPECT_NE(input_kind(name, input["names"][0].get<std::string>()), InputKind::kUnknown)
          << name << ' ' << input["names"][0] << " (" << input["help"] << ")";
    }
  }
}

// A text that the help calls a file must not be in the table of plain values by mistake.
TEST(VerbPolicy, ClassifiesNoFileFlagAsAValue) {
  const std::set<std::string> reviewed = {"--segment",  // names of the files come from -o
                                          "--size",     // of images
                                          "--keep",     // a time
                                          "--stages",   // exceptions by verb
                                          "--start",    // when a file begins
                                          "--mode",    "--only", "--draw",  "--face", "--width",
                                          "--side",    "--roi",  "--level", "--page", "--board"};
  for (const Json& verb : real_verbs().json()["verbs"]) {
    for (const Json& flag : verb["flags"]) {
      const std::string name = flag["names"][0];
      const std::string verb_name = verb["verb"];
      if (flag["type"] != "text" || !flag["choices"].empty() || reviewed.contains(name)) continue;
      if (flag_kind(verb_name, name) != FlagKind::kValue) continue;
      const std::string help = flag["help"];
      for (const char* word : {"file", "folder", "write", ".json", ".png", "list of", "path"}) {
        EXPECT_THAT(help, Not(HasSubstr(word))) << verb_name << ' ' << name;
      }
    }
  }
}

TEST(VerbPolicy, RefusesDangerousFlags) {
  for (const char* flag :
       {"--on-event", "--on-event-timeout", "--config", "--token-file", "--token", "--listen-all",
        "--insecure", "--ca-file", "--models-dir", "--actions"}) {
    bool is_anywhere = false;
    for (const Json& verb : real_verbs().json()["verbs"]) {
      if (VerbTable::find_flag(verb, flag) == nullptr) continue;
      is_anywhere = true;
      if (is_refused_verb(verb["verb"].get<std::string>())) continue;
      const std::string name = verb["verb"];
      EXPECT_EQ(flag_kind(name, flag), FlagKind::kRefused) << name << ' ' << flag;
      EXPECT_THAT(refusal(name, {}, {{flag, "/bin/sh"}}), HasSubstr("cannot be given")) << name;
    }
    EXPECT_TRUE(is_anywhere) << flag << " is no flag of any verb: take it out of the table";
  }
}

TEST(VerbPolicy, StartsNoOtherServer) {
  EXPECT_THAT(refusal("serve", {}), HasSubstr("cannot be started from a page"));
  EXPECT_THAT(refusal("demo", {}), HasSubstr("cannot be started from a page"));
  EXPECT_THAT(refusal("models import", {}), HasSubstr("cannot be started from a page"));
}

TEST(VerbPolicy, HasNoUnusedFlags) {
  // A name that is gone stays in nobody's way; one that comes back must be looked at again.
  EXPECT_EQ(flag_kind("plate read", "--exec"), FlagKind::kUnknown);
  EXPECT_THAT(refusal("plate read", {"set:a/1.jpg"}, {{"--exec", "x"}}), HasSubstr("no flag"));
  EXPECT_THAT(refusal("plate smash", {}), HasSubstr("no verb"));
}

TEST(VerbPolicy, BuildsACommandLine) {
  const CommandLine line =
      line_of("cartoon run", {"set:trip/a b.jpg"},
              {{"--mode", "sketch"}, {"-o", "out:drawn.png"}, {"--steady", true}});
  EXPECT_THAT(line.words, ElementsAre("cartoon", "run", "--mode=sketch", "--steady",
                                      "--output=/w/jobs/j1/files/drawn.png", "--json", "--",
                                      "/w/trip/a b.jpg"));
  EXPECT_THAT(line.shell_text, HasSubstr("tarsier cartoon run"));
  EXPECT_THAT(line.shell_text, HasSubstr("'/w/trip/a b.jpg'"));
  EXPECT_THAT(line.outputs, ElementsAre("drawn.png"));
}

TEST(VerbPolicy, AddsFlagsOfTheServer) {
  EXPECT_THAT(line_of("people list", {}).words, Contains("--gallery=/w/gallery"));
  EXPECT_THAT(line_of("people forget", {"Ann"}).words, Contains("--yes"));
  EXPECT_THAT(line_of("cartoon run", {"synth:portrait?live=1"}, Json::object(), Use::kLive).words,
              Contains("--window"));
  EXPECT_THAT(line_of("sfm reconstruct", {"set:trip"}, {{"-o", "out:model"}}, Use::kJob).words,
              Contains("--progress=json"));
  // Without a place for images the verb would open a window.
  EXPECT_THAT(line_of("landmarks fit", {"set:a/1.jpg"}).words, Contains("--output=none"));
  EXPECT_THAT(line_of("cartoon run", {"set:a"}, {{"--output", "none"}}).words,
              Contains("--output=none"));
  // A verb without a window has no such value.
  EXPECT_THAT(line_of("sfm reconstruct", {"set:trip"}).words, Not(Contains("--output=none")));
  EXPECT_THAT(refusal("sfm reconstruct", {"set:trip"}, {{"--output", "none"}}),
              Not(HasSubstr("taken")));
  EXPECT_THAT(refusal("models list", {}, Json::object(), Use::kLive), HasSubstr("cannot run live"));
}

TEST(VerbPolicy, RefusesJobsThatWouldOpenAWindow) {
  for (const Use use : {Use::kRun, Use::kJob}) {
    EXPECT_THAT(refusal("landmarks show", {"ws:set.yaml"}, Json::object(), use),
                testing::StartsWith("--output: expected the name of an image file"));
    EXPECT_THAT(refusal("aam explore", {}, Json::object(), use),
                testing::StartsWith("--output or --grid: expected the name of an image file"));
    // A switch that the page may not set makes no difference.
    EXPECT_THAT(refusal("aam explore", {}, {{"--window", true}, {"--random", true}}, use),
                testing::StartsWith("--output or --grid: expected the name of an image file"));
    EXPECT_THAT(refusal("aam explore", {}, {{"--output", nullptr}}, use), Not(HasSubstr("taken")));
    EXPECT_THAT(refusal("landmarks annotate", {"set:a"}, {{"-o", "ws:faces.json"}}, use),
                HasSubstr("works only in a window"));

    EXPECT_THAT(line_of("landmarks show", {"ws:set.yaml"}, {{"-o", "out:a.png"}}, use).words,
                Contains("--output=/w/jobs/j1/files/a.png"));
    EXPECT_THAT(line_of("aam explore", {}, {{"--output", "out:a.png"}}, use).outputs,
                ElementsAre("a.png"));
    EXPECT_THAT(line_of("aam explore", {}, {{"--grid", "out:a.png"}}, use).outputs,
                ElementsAre("a.png"));
  }
  EXPECT_THAT(line_of("landmarks show", {"ws:set.yaml"}, Json::object(), Use::kLive).words,
              Contains("--window"));
  EXPECT_THAT(line_of("aam explore", {}, Json::object(), Use::kLive).words, Contains("--window"));
}

TEST(VerbPolicy, KnowsHowEachVerbOpensNoWindow) {
  // These open a window only with --window, which no page can give to a run or a job.
  const std::set<std::string> reviewed = {"calibrate", "sfm reconstruct"};
  for (const Json& verb : real_verbs().json()["verbs"]) {
    const std::string name = verb["verb"];
    if (!has_window(verb) || is_refused_verb(name) || reviewed.contains(name)) continue;
    const Json* output = VerbTable::find_flag(verb, "--output");
    const bool has_value = output != nullptr && output->at("headless_value").is_string();
    const bool is_listed = std::any_of(kWindowVerbs.begin(), kWindowVerbs.end(),
                                       [&](const WindowVerb& row) { return row.verb == name; });
    EXPECT_NE(has_value, is_listed)
        << name << ": its --output needs a headless_value, or the verb a row in kWindowVerbs";
  }
  for (const WindowVerb& row : kWindowVerbs) {
    const Json* verb = real_verbs().find(row.verb);
    ASSERT_NE(verb, nullptr) << row.verb;
    EXPECT_TRUE(has_window(*verb)) << row.verb;
    for (const std::string_view flag : row.outputs) {
      if (flag.empty()) continue;
      const Json* found = VerbTable::find_flag(*verb, flag);
      ASSERT_NE(found, nullptr) << row.verb << ' ' << flag;
      EXPECT_EQ(found->at("names").front(), flag);
      EXPECT_EQ(flag_kind(row.verb, flag), FlagKind::kOutput);
    }
  }
}

// A page learns from the text of /api/help which verbs need an output.
TEST(VerbPolicy, DescribesVerbsThatNeedAnOutput) {
  const Json help = Json::parse(real_verbs().text());
  EXPECT_EQ(help, real_verbs().json());
  Json found = Json::object();
  for (const Json& verb : help["verbs"]) {
    if (verb.contains("needs_output")) {
      found[verb["verb"].get<std::string>()] = verb["needs_output"];
    }
  }
  EXPECT_EQ(found, Json({{"aam explore", {"--output", "--grid"}},
                         {"landmarks annotate", Json::array()},
                         {"landmarks show", Json::array({"--output"})}}));
}

TEST(VerbPolicy, AcceptsOnlyReferences) {
  for (const char* input : {"/etc/passwd", "../x", "http://host/a.jpg", "rtsp://host/", "@list.txt",
                            "*.jpg", "0", "/dev/video0", "picam:", "file:///etc/passwd", "a.jpg",
                            "", "-", "gst:x", "synth:a b", "synth:../x", "~/.ssh/id_rsa"}) {
    EXPECT_THAT(refusal("cartoon run", {input}), Not(HasSubstr("taken"))) << input;
  }
  for (const char* file : {"/etc/passwd", "../x", "http://h/", "plain.json", "@x", "out:x"}) {
    EXPECT_THAT(refusal("landmarks fit", {"set:a"}, {{"--model", file}}), Not(HasSubstr("taken")))
        << file;
    EXPECT_THAT(refusal("ar markers", {"set:a"}, {{"--camera", file}}),
                testing::AnyOf(Not(HasSubstr("taken")), HasSubstr("--camera=plain.json")))
        << file;
  }
  EXPECT_THAT(line_of("ar markers", {"set:a"}, {{"--camera", "500,500,320,240"}}).words,
              Contains("--camera=500,500,320,240"));
  EXPECT_THAT(line_of("ar markers", {"set:a"}, {{"--camera", "ws:camera.yml"}}).words,
              Contains("--camera=/w/camera.yml"));
  // A camera is a source, never a file.
  EXPECT_THAT(refusal("plate segment", {"camera:0"}, {{"-o", "out:x"}}), Not(HasSubstr("taken")));
}

TEST(VerbPolicy, WritesResultsOnlyBelowTheJob) {
  for (const char* place : {"/tmp/x", "../x", "out:../x", "out:a/b", "out:.hidden",
                            "out:", "set:a/b.png", "http://127.0.0.1:8080/", "ws:gallery",
                            "ws:plates.db", "ws:../x", "ws:.studio", "x.png", "out:a\nb", "-"}) {
    EXPECT_THAT(refusal("cartoon run", {"set:a"}, {{"--output", place}}), Not(HasSubstr("taken")))
        << place;
  }
  EXPECT_THAT(refusal("cartoon run", {"synth:scene"}, {{"--output", "out:a.png"}}, Use::kLive),
              HasSubstr("live session"));
  EXPECT_THAT(line_of("landmarks annotate", {"set:a"}, {{"-o", "ws:faces.json"}}, Use::kLive).words,
              Contains("--output=/w/faces.json"));
  EXPECT_THAT(refusal("people list", {}, {{"--gallery", "out:g"}}), Not(HasSubstr("taken")));
  EXPECT_THAT(refusal("plate log", {"set:a/plates.db"}), Not(HasSubstr("taken")));
}

TEST(VerbPolicy, ChecksValues) {
  EXPECT_THAT(refusal("cartoon run", {"set:a"}, {{"--frames", "x"}}), HasSubstr("whole number"));
  EXPECT_THAT(refusal("cartoon run", {"set:a"}, {{"--frames", 1.5}}), HasSubstr("whole number"));
  EXPECT_THAT(refusal("cartoon run", {"set:a"}, {{"--frames", -1}}), HasSubstr("out of range"));
  EXPECT_THAT(refusal("cartoon run", {"set:a"}, {{"--threads", 100000}}),
              HasSubstr("out of range"));
  EXPECT_THAT(refusal("cartoon run", {"set:a"}, {{"--skin-style", "nice"}}),
              HasSubstr("not one of glow, tint"));
  EXPECT_THAT(refusal("cartoon run", {"set:a"}, {{"--steady", "yes"}}), HasSubstr("true or false"));
  EXPECT_THAT(refusal("cartoon run", {"set:a"}, {{"--mode", "/etc/passwd"}}),
              HasSubstr("looks like a path"));
  EXPECT_THAT(refusal("cartoon run", {"set:a"}, {{"--mode", ""}}), HasSubstr("empty"));
  EXPECT_THAT(refusal("cartoon run", {"set:a"}, {{"--mode", Json::array()}}),
              Not(HasSubstr("taken")));
  EXPECT_THAT(refusal("cartoon run", {"set:a"}, {{"--mode", {"a", "b"}}}), Not(HasSubstr("taken")));
  EXPECT_THAT(refusal("cartoon run", {"set:a"}, {{"--mode", Json::object()}}),
              Not(HasSubstr("taken")));
  EXPECT_THAT(refusal("cartoon run", {"set:a"}, {{"--output", "out:a.png"}, {"-o", "out:b.png"}}),
              HasSubstr("given twice"));
  EXPECT_THAT(refusal("cartoon run", {}), HasSubstr("needs INPUT"));
  EXPECT_THAT(refusal("people forget", {"Ann", "Bob"}), HasSubstr("takes 1 input"));
  EXPECT_THAT(line_of("cartoon run", {"set:a"}, {{"--pepper", false}}).words,
              Contains("--no-pepper"));
  EXPECT_THAT(line_of("cartoon run", {"set:a"}, {{"--fps", 12.5}}).words, Contains("--fps=12.5"));
  EXPECT_THAT(line_of("landmarks eval", {"set:a"}, {{"--eyes", {36, 45}}}).words,
              Contains("--eyes=36"));
  EXPECT_THAT(refusal("landmarks eval", {"set:a"}, {{"--eyes", {36}}}), HasSubstr("2 values"));
}

TEST(VerbPolicy, AcceptsAnyNameOfAPerson) {
  const CommandLine line =
      line_of("people enroll", {"-x <img onerror=1>'é", "set:ann"}, {{"--note", "agreed / 2026"}});
  EXPECT_EQ(*(line.words.end() - 3), "--");
  EXPECT_EQ(*(line.words.end() - 2), "-x <img onerror=1>'é");
  EXPECT_THAT(line.shell_text, HasSubstr("'-x <img onerror=1>'\\''é'"));
  EXPECT_EQ(line.audit, "enrol");
  for (const std::string& name :
       {std::string("a\nb"), std::string("a\x01"), std::string("\xff"), std::string("\xe2\x80\xae"),
        std::string(2000, 'x'), std::string()}) {
    EXPECT_THAT(refusal("people forget", {name}), Not(HasSubstr("taken")));
  }
}

TEST(VerbPolicy, HidesAddressesOfSources) {
  const CommandLine line = line_of("cartoon run", {"allowed:door"}, Json::object(), Use::kLive);
  EXPECT_THAT(line.words, Contains("http://user:secret@cam/allowed:door"));
  EXPECT_THAT(line.shell_text, Not(HasSubstr("secret")));
  EXPECT_THAT(line.shell_text, HasSubstr("allowed:door"));
  EXPECT_EQ(without_secrets("http://***@cam/allowed:door", line.secrets), "allowed:door");
}

// What the child says of a source that it cannot open names the parts of its address.
TEST(VerbPolicy, HidesThePartsOfAddresses) {
  References references = some_references();
  references.source = [](const std::string& reference) -> std::string {
    if (reference == "allowed:door")
      return "http://bob:pw@10.0.0.7:8080/a/cam.mjpg?channel=7&pwd=x";
    if (reference == "allowed:yard") return "RTSP://[fd00::7]/b";
    return "http://frame/a";
  };
  const auto shown = [&](const std::string& source, const std::string& text) {
    const CommandLine line =
        command_line(real_verbs(), {"cartoon run", {source}, {{"--output", "out:x.png"}}},
                     Use::kRun, references);
    return without_secrets(text, line.secrets);
  };
  EXPECT_EQ(shown("allowed:door",
                  "http://***@10.0.0.7:8080/a/cam.mjpg?channel=7&pwd=***: nothing listens on port "
                  "8080 of 10.0.0.7 (connection refused)"),
            "allowed:door: nothing listens on allowed:door (connection refused)");
  EXPECT_EQ(shown("allowed:door", "10.0.0.7 does not answer on port 8080"),
            "allowed:door does not answer");
  EXPECT_EQ(shown("allowed:door", "redirects to 'http://10.0.0.7:8080/b'; only https is followed"),
            "redirects to 'http://allowed:door/b'; only https is followed");
  EXPECT_EQ(shown("allowed:door", "its certificate is not for '10.0.0.7'"),
            "its certificate is not for 'allowed:door'");
  EXPECT_EQ(shown("allowed:yard", "RTSP://[fd00::7]/b: nothing listens on port 554 of fd00::7"),
            "allowed:yard: nothing listens on allowed:yard");
  EXPECT_EQ(shown("allowed:hall", R"({"frame":3,"source":"http://frame/a"})"),
            R"({"frame":3,"source":"allowed:hall"})")
      << "a host of one word is no word of the output";
  EXPECT_EQ(shown("allowed:hall", "unknown host 'frame'"), "unknown host 'allowed:hall'");
  const CommandLine two = command_line(
      real_verbs(), {"sfm reconstruct", {"allowed:door", "allowed:yard"}, {{"--output", "out:m"}}},
      Use::kRun, references);
  EXPECT_TRUE(
      std::is_sorted(two.secrets.begin(), two.secrets.end(),
                     [](const auto& a, const auto& b) { return a.first.size() > b.first.size(); }));
}

TEST(VerbPolicy, ReadsRequests) {
  EXPECT_THROW((void)verb_request(Json::array()), UsageError);
  EXPECT_THROW((void)verb_request({{"verb", 3}}), UsageError);
  EXPECT_THROW((void)verb_request({{"verb", "x"}, {"inputs", "a"}}), UsageError);
  EXPECT_THROW((void)verb_request({{"verb", "x"}, {"inputs", {1}}}), UsageError);
  EXPECT_THROW((void)verb_request({{"verb", "x"}, {"flags", {1}}}), UsageError);
  EXPECT_EQ(verb_request({{"verb", "x"}}).verb, "x");
}

TEST(VerbPolicy, KnowsGoodNames) {
  for (const char* name : {"a", "Grüße aus 東京.jpg", "IMG (1).jpg", "a-b_c.d", "it's"}) {
    EXPECT_TRUE(is_good_name(name)) << name;
  }
  for (const std::string& name :
       {std::string(), std::string("."), std::string(".."), std::string(".x"), std::string("a/b"),
        std::string("a\\b"), std::string("a\0b", 3), std::string("a\n"), std::string("*"),
        std::string("a?"), std::string("[a]"), std::string(121, 'a'), std::string(" a"),
        std::string("a "), std::string("\xc0\xaf"), std::string("\xed\xa0\x80"),
        std::string("\x7f"), std::string("\xe2\x80\xae")}) {
    EXPECT_FALSE(is_good_name(name)) << name;
  }
}

}  // namespace
}  // namespace tarsier::web
