// SPDX-License-Identifier: MIT
#include "tarsier/plate/reader/reader.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/plate/networks/reading_json.h"
#include "tarsier/synth/sources.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::plate {
namespace {

using testing::HasSubstr;

const ModelStore& models() {
  static const ModelStore store(TARSIER_SOURCE_MODELS);
  return store;
}

// A synthetic street, shared by the tests; empty if there are no typefaces to draw plates with.
const std::optional<Frame>& street() {
  static const std::optional<Frame> frame = []() -> std::optional<Frame> {
    try {
      const auto source = synth::open_synth_source("car?seed=11&frames=1&size=640x360");
      return source->next(std::chrono::seconds(10), {});
    } catch (const InputError&) {
      return std::nullopt;
    }
  }();
  return frame;
}

class ReaderOnStreet : public testing::Test {
 protected:
  void SetUp() override {
    if (!street()) GTEST_SKIP() << "no typefaces to draw plates with";
    still_ = *street();
    still_.still = true;
  }
  Frame still_;
};

std::vector<std::string> texts_of(const ReaderResult& result) {
  std::vector<std::string> texts;
  for (const Reading& plate : result.plates) texts.push_back(plate.text);
  return texts;
}

// Names of the stages.
class Stages final : public DebugSink {
 public:
  void image(std::string_view name, const cv::Mat&) override { names.emplace_back(name); }
  std::vector<std::string> names;
};

TEST_F(ReaderOnStreet, ResultEqualsTheRecognizers) {
  const Reader reader = Reader::load(models());
  Stages stages;
  Timers timers;
  const ReaderResult result = reader.process(still_, &stages, &timers);
  const std::vector<Reading> expected = load_recognizer(models()).read(still_.image);
  ASSERT_FALSE(expected.empty());
  ASSERT_EQ(result.plates.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i)
    EXPECT_EQ(reading_json(result.plates[i]), reading_json(expected[i]));
  EXPECT_GT(result.ms, 0);
  EXPECT_FALSE(stages.names.empty());
  EXPECT_FALSE(timers.stats().empty());

  const nlohmann::ordered_json json = to_json(result);
  EXPECT_EQ(json.begin().key(), "plates");
  EXPECT_EQ(json["plates"][0], reading_json(expected[0]));
  EXPECT_GE(json["ms"], 0);
}

TEST_F(ReaderOnStreet, OptionsLimitTheResults) {
  ReaderOptions options;
  options.max_candidates = 1;
  const ReaderResult all = Reader::load(models(), options).process(still_);
  ASSERT_FALSE(all.plates.empty());
  for (const Reading& plate : all.plates) EXPECT_LE(plate.candidates.size(), 1U);
  options.min_confidence = 1;
  for (const Reading& plate : Reader::load(models(), options).process(still_).plates)
    EXPECT_EQ(plate.confidence, 1);
}

TEST_F(ReaderOnStreet, TextbookPipelineUsesItsOwnModels) {
  ReaderOptions options;
  options.pipeline = Pipeline::kTextbook;
  const auto model =
      read_classic_model(models().path("plate-svm.json"), models().path("plate-hog.json"));
  const std::vector<Reading> expected =
      read_classic(still_.image, *model, options.textbook, nullptr);
  const ReaderResult result = Reader::load(models(), options).process(still_);
  std::vector<std::string> texts;
  for (const Reading& plate : expected) texts.push_back(plate.text);
  EXPECT_EQ(texts_of(result), texts);
}

TEST(ReaderLoading, ErrorNamesTheMissingFile) {
  const TemporaryFolder empty;
  try {
    static_cast<void>(Reader::load(ModelStore(empty.path())));
    FAIL();
  } catch (const ModelError& error) {
    EXPECT_THAT(error.what(), HasSubstr(empty / "countries"));
  }
  ReaderOptions options;
  options.detector_model = empty / "mine.json";
  try {
    static_cast<void>(Reader::load(models(), options));
    FAIL();
  } catch (const ModelError& error) {
    EXPECT_THAT(error.what(), HasSubstr(empty / "mine.json"));
  }
}

TEST(ReaderLoading, RejectsInvalidOptions) {
  ReaderOptions options;
  options.countries = {"zz"};
  EXPECT_THROW(static_cast<void>(Reader::load(models(), options)), UsageError);
  options = {};
  options.min_confidence = 1.5;
  EXPECT_THROW(static_cast<void>(Reader::load(models(), options)), std::invalid_argument);
  options = {};
  options.max_candidates = 0;
  EXPECT_THROW(options.check(), std::invalid_argument);
  options = {};
  options.decoding.beam = 0;
  EXPECT_THROW(options.check(), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::plate
