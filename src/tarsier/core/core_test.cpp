// SPDX-License-Identifier: MIT
#include "tarsier/core/cpu.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/length.h"
#include "tarsier/core/log.h"
#include "tarsier/core/markup.h"
#include "tarsier/core/measures.h"
#include "tarsier/core/progress.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/core/timer.h"
#include "tarsier/core/words.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <cmath>
#include <csignal>
#include <cstdio>
#include <limits>
#include <optional>
#include <sched.h>
#include <string>
#include <string_view>
#include <unistd.h>
#include <vector>

namespace tarsier {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

TEST(Rng, SameSeedGivesTheSameNumbersEverywhere) {
  Rng rng(42);
  const std::vector<std::uint64_t> first{rng(), rng()};
  Rng again(42);
  EXPECT_EQ(first, (std::vector<std::uint64_t>{again(), again()}));
  EXPECT_EQ(first[0], 1546998764402558742U);  // pinned: results must not change between versions
}

TEST(Length, ParsesUnits) {
  EXPECT_DOUBLE_EQ(parse_length("25mm", "--square"), 0.025);
  EXPECT_DOUBLE_EQ(parse_length("2.5cm", "--square"), 0.025);
  EXPECT_DOUBLE_EQ(parse_length("0.5m", "--square"), 0.5);
  EXPECT_DOUBLE_EQ(parse_length(".05", "--square"), 0.05);
  for (const char* text : {"", "mm", "-5mm", "0mm", "5 mm", "5inch", "nan", "inf", "1e9m", "5mmm",
                           "1e-400mm", "2mm\n", "25", "1"}) {
    EXPECT_THROW((void)parse_length(text, "--square"), UsageError) << text;
  }
}

TEST(Rng, ForkDependsOnTheStreamAndNotOnTheDrawsBefore) {
  Rng a(7);
  const std::uint64_t early = a.fork(3)();
  for (int i = 0; i < 10; ++i) a();
  EXPECT_EQ(a.fork(3)(), early);
  EXPECT_NE(a.fork(4)(), early);
}

TEST(Rng, IntegersCoverTheClosedRangeEvenly) {
  Rng rng(1);
  std::vector<int> counts(6, 0);
  for (int i = 0; i < 60000; ++i) ++counts.at(static_cast<size_t>(rng.integer(-2, 3) + 2));
  for (const int count : counts) EXPECT_NEAR(count, 10000, 500);
  EXPECT_THROW(rng.integer(3, 2), std::invalid_argument);
}

TEST(Rng, NormalHasTheRequestedMeanAndDeviation) {
  Rng rng(5);
  double sum = 0;
  double squares = 0;
  constexpr int kCount = 100000;
  for (int i = 0; i < kCount; ++i) {
    const double x = rng.normal(3, 2);
    sum += x;
    squares += x * x;
  }
  const double mean = sum / kCount;
  EXPECT_NEAR(mean, 3, 0.03);
  EXPECT_NEAR(std::sqrt(squares / kCount - mean * mean), 2, 0.03);
}

TEST(Errors, HaveAKindAndAPath) {
  try {
    throw ModelError("plate.svm", "cut short");
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kModel);
    EXPECT_STREQ(error.what(), "plate.svm: cut short");
  }
}

TEST(Errors, MissingEntryErrorNamesTheKindOfEntry) {
  const MissingEntryError error("people.db", "face", "there is no face 7");
  EXPECT_EQ(error.entry(), "face");
  EXPECT_EQ(error.kind(), ErrorKind::kInput);
  EXPECT_STREQ(error.what(), "people.db: there is no face 7");
}

TEST(Require, NamesTheExpressionAndTheValue) {
  try {
    const int size = -3;
    TARSIER_REQUIRE(size > 0, "got {}", size);
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), HasSubstr("requires size > 0: got -3"));
  }
}

TEST(Log, ControlCharactersCannotReachTheTerminal) {
  EXPECT_EQ(printable("a\x1b[2Jb\n"), "a\\x1b[2Jb\\n");
  EXPECT_EQ(printable("Müller.jpg"), "Müller.jpg");
  EXPECT_THROW((void)parse_log_level("loud"), std::invalid_argument);
}

TEST(Timers, ReportLastAverageMinAndMax) {
  Timers timers;
  timers.add("median", 2);
  timers.add("median", 6);
  timers.add("median", 1);
  timers.add("paint", 5);
  const std::vector<TimerStats> stats = timers.stats();
  ASSERT_EQ(stats.size(), 2U);
  EXPECT_EQ(stats[0].name, "median");
  EXPECT_EQ(stats[0].runs, 3);
  EXPECT_DOUBLE_EQ(stats[0].last_ms, 1);
  EXPECT_DOUBLE_EQ(stats[0].average_ms(), 3);
  EXPECT_DOUBLE_EQ(stats[0].min_ms, 1);
  EXPECT_DOUBLE_EQ(stats[0].max_ms, 6);
  EXPECT_THAT(timers.report(), HasSubstr("median"));
}

TEST(Timers, AScopeAddsOneRun) {
  Timers timers;
  { const auto scope = timers.time("stage"); }
  ASSERT_EQ(timers.stats().size(), 1U);
  EXPECT_EQ(timers.stats()[0].runs, 1);
}

std::string printed(ProgressStyle style) {
  std::FILE* file = std::tmpfile();
  {
    const auto progress = make_progress(style, file);
    progress->begin("match", 4, "pairs");
    progress->advance(4);
    progress->end();
  }
  std::string text(4096, '\0');
  std::rewind(file);
  text.resize(std::fread(text.data(), 1, text.size(), file));
  std::fclose(file);
  return text;
}

TEST(Progress, JsonLinesEndWithTheTotal) {
  const std::string text = printed(ProgressStyle::kJson);
  EXPECT_THAT(text,
              StartsWith("{\"progress\":\"match\",\"done\":0,\"total\":4,\"unit\":\"pairs\""));
  EXPECT_THAT(text, HasSubstr("\"done\":4,\"total\":4"));
}

TEST(Progress, JsonLinesContainMeasuredValues) {
  std::FILE* file = std::tmpfile();
  {
    const auto progress = make_progress(ProgressStyle::kJson, file);
    progress->begin("reader", 300, "steps");
    for (const double loss : {2.5, 0.125, std::numeric_limits<double>::quiet_NaN()}) {
      report_measure(*progress, "loss", loss);
      progress->advance(100);
    }
    progress->end();
  }
  std::string text(4096, '\0');
  std::rewind(file);
  text.resize(std::fread(text.data(), 1, text.size(), file));
  std::fclose(file);
  EXPECT_THAT(text, HasSubstr("\"done\":100,\"total\":300,\"unit\":\"steps\""));
  EXPECT_THAT(text, HasSubstr(",\"loss\":2.5}\n"));
  EXPECT_THAT(text, HasSubstr(",\"loss\":0.125}\n"));
  EXPECT_THAT(text, testing::Not(HasSubstr("nan")));
}

TEST(Progress, BarIsSilentWhereThereIsNoTerminal) {
  EXPECT_EQ(printed(ProgressStyle::kAuto), "");
  EXPECT_THAT(printed(ProgressStyle::kBar), HasSubstr("100 %"));
  EXPECT_EQ(printed(ProgressStyle::kNone), "");
}

TEST(Stop, SleepEndsAtOnceWhenStopped) {
  std::stop_source source;
  EXPECT_TRUE(sleep_unless_stopped(std::chrono::milliseconds(1), source.get_token()));
  source.request_stop();
  EXPECT_FALSE(sleep_unless_stopped(std::chrono::hours(1), source.get_token()));
  EXPECT_THROW(throw_if_stopped(source.get_token()), Interrupted);
}

TEST(Markup, EscapesTagsAndAttributes) {
  EXPECT_EQ(escaped_markup("<a href='x' title=\"y\">&\x01\x1b\n\u00e9"),
            "&lt;a href=&#39;x&#39; title=&quot;y&quot;&gt;&amp;\n\u00e9");
}

TEST(Words, ALineIsSplitIntoWords) {
  std::string_view text = " \tf 1,5\r\n\nlast";
  std::string_view line = next_line(text);
  EXPECT_EQ(next_word(line), "f");
  EXPECT_EQ(next_word(line), "1,5");
  EXPECT_EQ(next_word(line), "");
  EXPECT_EQ(next_line(text), "");
  EXPECT_EQ(next_line(text), "last");
  EXPECT_TRUE(text.empty());
  EXPECT_EQ(trimmed("\t a b \r"), "a b");
  EXPECT_EQ(trimmed(" \r"), "");
  EXPECT_EQ(lower_case("HTTP://X\xC3\x84"), "http://x\xC3\x84");
}

TEST(Words, NumbersAreWholeWordsAndFinite) {
  EXPECT_EQ(to_number("+1.5e2"), 150);
  EXPECT_EQ(to_integer("-7", -7, 3), -7);
  for (const char* word : {"", "+", "+-1", "1,5", "1x", "nan", "inf", "1e999", " 1"})
    EXPECT_FALSE(to_number(word)) << word;
  for (const char* word : {"", "1.0", "4", "-8", "99999999999999999999"})
    EXPECT_FALSE(to_integer(word, -7, 3)) << word;
}

TEST(EndOnSignals, EndsAtTheFirstSignal) {
  // Runs in a child process that does not check the stop token. Without EndOnSignals it would
  // continue and exit with 0.
  const auto work = [](bool at_once) {
    static_cast<void>(stop_on_signals());
    std::optional<EndOnSignals> ends;
    if (at_once) ends.emplace();
    kill(getpid(), SIGINT);
    if (at_once) pause();
    while (!stop_on_signals().stop_requested()) sched_yield();
    _exit(0);
  };
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(work(true), testing::ExitedWithCode(130), "");
  EXPECT_EXIT(work(false), testing::ExitedWithCode(0), "");
}

TEST(Cpu, LimitNeverExceedsTheHardware) {
  limit_simd_level(SimdLevel::kAvx512);
  EXPECT_EQ(simd_level(), hardware_simd_level());
  limit_simd_level(SimdLevel::kBaseline);
  EXPECT_EQ(simd_level(), SimdLevel::kBaseline);
}

}  // namespace
}  // namespace tarsier
