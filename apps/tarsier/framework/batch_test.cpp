// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/media/sha256.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "framework/journal.h"
#include "framework/part_info.h"
#include <filesystem>
#include <fstream>
#include <numeric>
#include <sstream>

namespace tarsier::cli {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

std::string content(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

template <class Call>
std::string error_of(Call call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

TEST(ParseShard, ParsesNumberAndCount) {
  EXPECT_EQ(parse_shard("3/20").number, 3);
  EXPECT_EQ(parse_shard("3/20").count, 20);
  for (const char* text : {"", "3", "0/4", "5/4", "-1/4", "1/0", "a/b", "1/4x", "1/ 4", "1//4"}) {
    EXPECT_THROW((void)parse_shard(text), UsageError) << text;
  }
}

TEST(ShardOf, DependsOnlyOnTheName) {
  // `printf a.jpg | sha256sum` begins with 509b0d4641a7c3ba, the other name's with
  // ce7f4df72d405389.
  EXPECT_EQ(shard_of("a.jpg", 20), 7);
  EXPECT_EQ(shard_of("a.jpg", 7), 5);
  EXPECT_EQ(shard_of("photos/b 2.png", 20), 2);
  EXPECT_EQ(shard_of("a.jpg", 1), 1);
  std::vector<int> sizes(4);
  for (int i = 0; i < 4000; ++i)
    ++sizes[static_cast<std::size_t>(shard_of("img" + std::to_string(i), 4)) - 1];
  for (const int size : sizes) EXPECT_NEAR(size, 1000, 120);  // four standard deviations
}

class JournalTest : public FolderTest {
 protected:
  std::vector<std::string> lines(const Journal& journal) {
    std::vector<std::string> lines;
    journal.read([&](const JournalEntry& entry) {
      lines.push_back(entry.skipped.empty() ? entry.line : "- " + entry.skipped);
    });
    return lines;
  }
  std::string file_ = path("journal");
};

TEST_F(JournalTest, ResumesAfterTheLastCompleteEntry) {
  {
    Journal journal(file_, "{}", false);
    journal.add({4, "four", {"4,1", "4,2"}, {}});
    journal.add({2, "two", {}, {}});
    journal.add({3, {}, {}, "is broken"});
  }
  const std::string whole = content(file_);
  // Killed within an entry: at each byte of the last one.
  for (std::size_t size = whole.rfind('\n', whole.size() - 2) + 1; size < whole.size(); ++size) {
    std::ofstream(file_, std::ios::binary) << whole.substr(0, size);
    Journal journal(file_, "{}", true);
    EXPECT_THAT(journal.inputs(), ElementsAre(2, 4));
    journal.add({3, "three", {}, {}});
    EXPECT_THAT(lines(journal), ElementsAre("two", "three", "four"));
  }
  Journal journal(file_, "{}", true);
  EXPECT_THAT(lines(journal), ElementsAre("two", "three", "four"));
}

TEST_F(JournalTest, RefusesAConcurrentRunAndAnotherBatch) {
  {
    Journal journal(file_, "{\"a\":1}", false);
    journal.add({0, "x", {}, {}});
    EXPECT_THAT(error_of([&] { Journal second(file_, "{\"a\":1}", true); }),
                HasSubstr("another program is writing it"));
  }
  EXPECT_THAT(error_of([&] { Journal other(file_, "{\"a\":2}", true); }),
              HasSubstr("other inputs"));
  EXPECT_THAT(Journal(file_, "{\"a\":1}", true).inputs(), ElementsAre(0));
  EXPECT_THAT(Journal(file_, "{\"a\":2}", false).inputs(), ElementsAre());
}

class MergeTest : public FolderTest {
 protected:
  // Part i of 3 of five inputs, of which the fourth could not be read; two lines of the first.
  std::string part(int number, const std::string& list = "L", const std::string& settings = "S") {
    const std::vector<std::vector<std::int64_t>> inputs{{0, 0, 4}, {}, {1, 2}};
    PartInfo info;
    info.shard = {number, 3};
    info.inputs = 5;
    info.list = list;
    info.settings = settings;
    info.lines = inputs[static_cast<std::size_t>(number) - 1];
    if (number == 2) info.skipped = {{3, "d: is broken"}};
    const std::string file = path("part-" + std::to_string(number));
    {
      std::ofstream out(file, std::ios::binary);
      int line = 0;
      for (const std::int64_t input : info.lines) out << input << ':' << line++ << '\n';
    }
    info.sha256 = sha256_of_file(file);
    write_part_info(file, info);
    return file;
  }
  std::string merge(const std::vector<std::string>& parts) {
    return error_of([&] { merge_parts(parts, path("all")); });
  }
};

TEST_F(MergeTest, OrdersLinesByInput) {
  const std::vector<std::string> parts{part(3), part(1), part(2), info_path(part(2))};
  const MergeReport report = merge_parts(parts, path("all"));
  EXPECT_EQ(content(path("all")), "0:0\n0:1\n1:0\n2:1\n4:2\n");
  EXPECT_EQ(report.shards, 3);
  EXPECT_EQ(report.inputs, 5);
  EXPECT_EQ(report.lines, 5);
  EXPECT_EQ(report.skipped, 1);
  const PartInfo info = read_part_info(path("all"));
  EXPECT_EQ(info.shard.count, 1);
  EXPECT_THAT(info.lines, ElementsAre(0, 0, 1, 2, 4));
  ASSERT_EQ(info.skipped.size(), 1U);
  EXPECT_EQ(info.skipped[0].second, "d: is broken");
}

TEST_F(MergeTest, RefusesInvalidNumbers) {
  const std::string file = part(1);
  const std::string good = content(info_path(file));
  for (const auto& [from, to] : {std::pair<std::string, std::string>{"[1,3]", "[1e300,3]"},
                                 {"\"inputs\":5", "\"inputs\":1e300"},
                                 {"\"inputs\":5", "\"inputs\":18446744073709551615"},
                                 {"[0,0,4]", "[0,0,4.5]"}}) {
    std::string text = good;
    ASSERT_NE(text.find(from), std::string::npos) << good;
    std::ofstream(info_path(file)) << text.replace(text.find(from), from.size(), to);
    EXPECT_NE(error_of([&] { (void)read_part_info(file); }), "") << to;
  }
}

TEST_F(MergeTest, RefusesMissingDuplicateUnfinishedAndForeignParts) {
  EXPECT_THAT(merge({part(1), part(3)}), HasSubstr("is one of 3 shards, of which 1 is missing: 2"));
  std::filesystem::copy_file(part(1), path("copy"));
  std::filesystem::copy_file(info_path(part(1)), info_path(path("copy")));
  EXPECT_THAT(merge({part(1), part(2), part(3), path("copy")}),
              HasSubstr("is shard 1/3, and so is"));
  EXPECT_THAT(merge({part(1), part(2, "other"), part(3)}), HasSubstr("different inputs"));
  EXPECT_THAT(merge({part(1), part(2, "L", "other"), part(3)}), HasSubstr("different flags"));
  EXPECT_THAT(merge({part(1), part(2), part(1) + "x"}), HasSubstr("no such part"));
  part(3);
  std::filesystem::remove(info_path(path("part-3")));
  EXPECT_THAT(merge({part(1), part(2), path("part-3")}), HasSubstr("is not finished"));
  part(3);
  std::ofstream(path("part-3"), std::ios::app) << "more\n";
  EXPECT_THAT(merge({part(1), part(2), path("part-3")}), HasSubstr("was changed"));
  std::ofstream(info_path(part(3))) << R"({"shard":[3,3],"inputs":5})";
  EXPECT_THAT(merge({part(1), part(2), path("part-3")}), HasSubstr("does not describe a part"));
  EXPECT_FALSE(std::filesystem::exists(path("all")));
  EXPECT_THROW(merge_parts({part(1), part(2), part(3)}, path("part-1")), UsageError);
}

}  // namespace
}  // namespace tarsier::cli
