// SPDX-License-Identifier: MIT
// The whole command line of the program, without running it.
#include "tarsier/core/csv.h"
#include "tarsier/core/errors.h"
#include "tarsier/face/landmarks/tracker.h"
#include "tarsier/face/pipelines/template_error.h"
#include "tarsier/plate/tracking/tracker.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "framework/areas.h"
#include "framework/cli.h"
#include "framework/command_json.h"
#include "framework/command_tree.h"
#include "framework/error_help.h"
#include "framework/manual.h"
#include "framework/parse.h"
#include "framework/run_session.h"
#include "verbs/people/recognition_events.h"
#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

namespace tarsier::cli {
namespace {

struct Program {
  Context context;
  Command root{"tarsier", "classical computer vision"};
  explicit Program(const std::vector<std::string>& words = {}) {
    context.words = words;
    add_areas(root, context);
  }
};

std::vector<std::string> areas_for(const std::vector<std::string>& words) {
  const Program program(words);
  std::vector<std::string> names;
  for (const Command* area : program.root.subcommands()) names.push_back(area->name());
  return names;
}

std::string name_of(const VerbInfo& verb) {
  std::string name;
  for (const std::string& word : verb.path) name += (name.empty() ? "" : " ") + word;
  return name;
}

// All verbs, by name.
std::map<std::string, VerbInfo> all_verbs() {
  const Program program;
  std::map<std::string, VerbInfo> verbs;
  for (const AreaInfo& area : command_tree(program.root)) {
    for (const VerbInfo& verb : area.verbs) verbs[name_of(verb)] = verb;
  }
  return verbs;
}

const FlagInfo& flag_of(const VerbInfo& verb, const std::string& name) {
  const auto at = std::find_if(verb.flags.begin(), verb.flags.end(), [&name](const FlagInfo& flag) {
    return std::find(flag.names.begin(), flag.names.end(), name) != flag.names.end();
  });
  if (at == verb.flags.end()) throw std::invalid_argument(name_of(verb) + " has no " + name);
  return *at;
}

TEST(Areas, CommandLineOfOneAreaAddsOnlyThatArea) {
  const Program all;
  for (const Command* area : all.root.subcommands()) {
    if (area->name() == "help") continue;
    const Program one({area->name()});
    EXPECT_THAT(areas_for({area->name()}), testing::ElementsAre(area->name()));
    const Command& same = *one.root.find(area->name());
    EXPECT_EQ(help_text(same), help_text(*area));
    ASSERT_EQ(same.subcommands().size(), area->subcommands().size()) << area->name();
    for (size_t i = 0; i < same.subcommands().size(); ++i) {
      EXPECT_EQ(help_text(*same.subcommands()[i]), help_text(*area->subcommands()[i]));
    }
  }
}

TEST(Areas, HelpUnknownWordsAndConfigFilesAddAllAreas) {
  const std::vector<std::string> all = areas_for({});
  EXPECT_GE(all.size(), 15u);
  EXPECT_EQ(areas_for({"help", "--json"}), all);
  EXPECT_EQ(areas_for({"--version"}), all);
  EXPECT_EQ(areas_for({"plates"}), all);
  EXPECT_EQ(areas_for({"plate", "read", "--config", "sections.toml"}), all);
  EXPECT_EQ(areas_for({"plate", "read", "--config=sections.toml"}), all);
}

TEST(Verbs, EachFlagHasADescriptionAndAValidDefault) {
  for (const auto& [name, verb] : all_verbs()) {
    std::set<std::string> known;
    for (const FlagInfo& flag : verb.flags) {
      for (const std::string& called : flag.names) {
        EXPECT_TRUE(known.insert(called).second) << name << ": " << called << " twice";
      }
    }
    for (const FlagInfo& flag : verb.flags) {
      const std::string called = name + ' ' + flag.names.front();
      EXPECT_TRUE(!flag.description.empty() || !flag.choices.empty()) << called;
      EXPECT_FALSE(flag.group.empty()) << called;
      for (const std::string& other : flag.needs) EXPECT_TRUE(known.count(other)) << called;
      for (const std::string& other : flag.excludes) EXPECT_TRUE(known.count(other)) << called;
      for (const std::string& word : flag.suggestions) {
        EXPECT_THAT(flag.description, testing::HasSubstr(word)) << called;
      }
      EXPECT_THAT(flag.description, testing::HasSubstr(flag.headless_value)) << called;
      const std::string& value = flag.default_value;
      if (value.empty() || flag.many || flag.min_values > 1) continue;
      if (!flag.choices.empty()) {
        EXPECT_THAT(flag.choices, testing::Contains(value)) << called;
      }
      if (!flag.suggestions.empty()) {
        EXPECT_THAT(flag.suggestions, testing::Contains(value)) << called;
      }
      if (flag.type != FlagType::kInteger && flag.type != FlagType::kNumber) continue;
      const double number = std::strtod(value.c_str(), nullptr);
      EXPECT_TRUE(!flag.range || flag.range->contains(number)) << called;
    }
  }
}

TEST(Verbs, HelpJsonManualAndCompletionNameEveryFlag) {
  Program program;
  const std::vector<AreaInfo> areas = command_tree(program.root);
  const auto json = nlohmann::json::parse(command_json(areas, version()));
  std::size_t count = 0;
  const std::string completion = bash_completion(areas);
  for (const AreaInfo& area : areas) {
    for (const VerbInfo& verb : area.verbs) {
      const std::string name = name_of(verb);
      const std::string help = help_text(*match_command(program.root, verb.path).command);
      const nlohmann::json& described = json["verbs"].at(count++);
      EXPECT_EQ(described["verb"], name);
      EXPECT_EQ(described["inputs"].size() + described["flags"].size(), verb.flags.size()) << name;
      EXPECT_THAT(help, testing::HasSubstr("Usage: tarsier " + name)) << name;
      EXPECT_THAT(help, testing::HasSubstr("Example: tarsier " + name)) << name;
      for (const FlagInfo& flag : verb.flags) {
        EXPECT_THAT(help, testing::HasSubstr(flag.names.front())) << name;
        if (flag.positional) continue;
        EXPECT_THAT(completion, testing::HasSubstr(flag.names.front())) << name;
      }
    }
  }
  EXPECT_EQ(json["verbs"].size(), count);
  EXPECT_GT(count, 50U);
}

TEST(Verbs, ExamplesCanBeParsed) {
  for (const auto& [name, verb] : all_verbs()) {
    std::vector<std::string> words;
    std::istringstream line(verb.example);
    for (std::string word; line >> word;) {
      word.erase(
          std::remove_if(word.begin(), word.end(), [](char c) { return c == '"' || c == '\''; }),
          word.end());
      words.push_back(word);
    }
    ASSERT_GE(words.size(), 2U) << name;
    if (verb.example.find('"') != std::string::npos ||
        verb.example.find('\'') != std::string::npos) {
      continue;  // a word with spaces: what a shell would do is not done here
    }
    words.erase(words.begin());
    Program program;
    try {
      const Command::Parsed parsed = parse_command_line(program.root, words);
      EXPECT_EQ(verb_of(*parsed.command), name);
      EXPECT_TRUE(program.context.run) << name;
    } catch (const std::exception& error) {
      ADD_FAILURE() << verb.example << ": " << error.what();
    }
  }
}

TEST(Verbs, FlagDefaultsAreThoseOfTheLibrary) {
  const std::map<std::string, VerbInfo> verbs = all_verbs();
  const auto number = [&verbs](const std::string& verb, const std::string& flag) {
    return std::stod(flag_of(verbs.at(verb), flag).default_value);
  };
  const plate::TrackerOptions plates;
  EXPECT_EQ(number("plate read", "--lost-after"), plates.lost_after);
  EXPECT_EQ(number("plate read", "--return-within"), plates.return_within);
  EXPECT_EQ(number("plate read", "--parked-return-within"), plates.parked_return_within);
  EXPECT_EQ(number("plate read", "--min-readings"), plates.min_readings);
  const face::landmarks::TrackerOptions faces;
  for (const char* verb : {"landmarks fit", "landmarks track"}) {
    EXPECT_EQ(number(verb, "--search-every"), faces.search_every);
    EXPECT_EQ(number(verb, "--min-score"), faces.min_score);
    EXPECT_EQ(number(verb, "--max-faces"), faces.max_faces);
  }
  const RunFlags run;
  for (const char* verb : {"cartoon run", "plate read", "pose track", "ar markers"}) {
    EXPECT_EQ(number(verb, "--width"), run.source.width) << verb;
    EXPECT_EQ(number(verb, "--every"), static_cast<double>(run.every)) << verb;
    EXPECT_EQ(number(verb, "--stall"), run.source.stall_s) << verb;
    EXPECT_EQ(number(verb, "--jpeg-quality"), run.sink.jpeg_quality) << verb;
  }
}

TEST(Verbs, CommonFlagsSetTheContext) {
  Program program;
  const Command::Parsed parsed = parse_command_line(
      program.root, {"plate", "read", "a.png", "--seed", "7", "--threads", "2", "--json"});
  EXPECT_EQ(verb_of(*parsed.command), "plate read");
  EXPECT_EQ(program.context.seed, 7U);
  EXPECT_EQ(program.context.threads, 2);
  EXPECT_TRUE(program.context.json);
  EXPECT_TRUE(program.context.run);
}

TEST(Verbs, CommonFlagsAreChecked) {
  const auto error = [](const std::vector<std::string>& flags) -> std::string {
    Program program;
    std::vector<std::string> words = {"doctor"};
    words.insert(words.end(), flags.begin(), flags.end());
    try {
      parse_command_line(program.root, words);
    } catch (const UsageError& caught) {
      return caught.what();
    }
    return "";
  };
  EXPECT_EQ(error({"--seed", "7"}), "");
  EXPECT_THAT(error({"--seed=-1"}), testing::HasSubstr("a seed is not negative"));
  EXPECT_THAT(error({"--threads=2000"}), testing::HasSubstr("expected 0..1024, got 2000"));
  EXPECT_THAT(error({"--log-level=loud"}), testing::HasSubstr("--log-level"));
}

TEST(RunFlags, DefaultToHeadlessWithoutOutputAndWindow) {
  RunFlags run;
  default_to_headless(run);
  EXPECT_EQ(run.output, "none");
  EXPECT_FALSE(opens_window(run));
  RunFlags window;
  window.window = true;
  default_to_headless(window);
  EXPECT_EQ(window.output, "");
  RunFlags file;
  file.output = "a.png";
  default_to_headless(file);
  EXPECT_EQ(file.output, "a.png");
}

TEST(FrameCells, NameOnlyStillImagesAndQuoteThem) {
  Frame frame;
  frame.index = 3;
  frame.time = 1.25;
  frame.name = "street.mp4";
  EXPECT_EQ(frame_cells(frame), "3,1.250,");
  frame.still = true;
  frame.name = "a,b.jpg";
  EXPECT_EQ(frame_cells(frame), "3,1.250,\"a,b.jpg\"");
}

TEST(FaceRows, HaveOneRowPerFaceAndOneCellPerColumn) {
  const auto cells = [](const std::string& line) { return csv_fields(line).value().size(); };
  std::vector<face::IdentifiedFace> faces(2);
  faces[0].face.id = 7;
  faces[0].face.box = {10.4, 20.6, 30, 40};
  faces[0].identity.label = "=Ann, B";
  faces[0].identity.confidence = 0.75;
  faces[0].identity.known = true;
  const std::vector<std::string> rows = face_rows({}, faces);
  ASSERT_EQ(rows.size(), 2U);
  EXPECT_EQ(rows[0], "0,0.000,,7,\"'=Ann, B\",0.7500,1,10,21,30,40");
  EXPECT_EQ(rows[1], "0,0.000,,0,,0.0000,0,0,0,0,0");
  for (const std::string& row : rows) EXPECT_EQ(cells(row), cells(kFaceColumns)) << row;
  EXPECT_TRUE(face_rows({}, {}).empty());
}

TEST(ExitStatus, DependsOnTheErrorKind) {
  const std::string path = "a.txt";
  EXPECT_EQ(exit_status(UsageError("no").kind()), ExitStatus::kUsage);
  EXPECT_EQ(exit_status(InputError(path, "no").kind()), ExitStatus::kBadInput);
  EXPECT_EQ(exit_status(SourceLostError(path, "no").kind()), ExitStatus::kSourceLost);
  EXPECT_EQ(exit_status(ModelError(path, "no").kind()), ExitStatus::kBadModel);
  EXPECT_EQ(exit_status(OutputError(path, "no").kind()), ExitStatus::kBadOutput);
  EXPECT_EQ(exit_status(Interrupted().kind()), ExitStatus::kInterrupted);
}

// What is named behind an error of the library exists.
TEST(ErrorHelp, NamesTheVerbThatListsTheEntries) {
  const auto verbs = all_verbs();
  for (const char* entry :
       {"correction", "face", "group", "member of a group", "person", "plate", "sighting"}) {
    const std::string help = error_help(MissingEntryError("people.db", entry, "no"));
    ASSERT_THAT(help, testing::StartsWith(": `")) << entry;
    const std::string command = help.substr(3, help.find('`', 3) - 3);
    const std::size_t flag = command.find(" --");
    const std::string verb = command.substr(0, flag);
    ASSERT_TRUE(verbs.contains(verb)) << verb;
    if (flag == std::string::npos) continue;
    const std::string name = command.substr(flag + 1, command.find(' ', flag + 1) - flag - 1);
    EXPECT_NO_THROW(static_cast<void>(flag_of(verbs.at(verb), name))) << command;
  }
  EXPECT_EQ(error_help(MissingEntryError("a.db", "thing", "no")), "");
}

TEST(ErrorHelp, NamesExistingVerbsAndFlags) {
  const auto verbs = all_verbs();
  using face::TemplateProblem;
  for (const auto problem : {TemplateProblem::kNotCalibrated, TemplateProblem::kOtherNetwork,
                             TemplateProblem::kNetworkNotGiven, TemplateProblem::kNotDeep,
                             TemplateProblem::kNotClassic}) {
    const std::string help = error_help(face::TemplateError(problem, "people.db", "no"));
    EXPECT_THAT(help, testing::StartsWith(": "));
    EXPECT_THAT(help, testing::HasSubstr("`people train --"));
    std::istringstream words(help);
    for (std::string word; words >> word;) {
      if (!word.starts_with("--")) continue;
      word.erase(word.find_last_not_of("`,") + 1);
      EXPECT_NO_THROW(static_cast<void>(flag_of(verbs.at("people train"), word))) << word;
    }
  }
  EXPECT_EQ(error_help(InputError("people.db", "no")), "");
}

}  // namespace
}  // namespace tarsier::cli
