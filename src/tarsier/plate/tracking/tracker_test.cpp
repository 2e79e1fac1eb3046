// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/tracker.h"

#include "tarsier/plate/tracking/testing_readings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>

namespace tarsier::plate {
namespace {

using ::testing::ElementsAre;
using ::testing::UnorderedElementsAre;

constexpr double kStep = 0.1;  // s between frames

Reading reading_at(const std::string& text, double x, double y, double width = 100,
                   double confidence = 0.9) {
  Reading reading;
  reading.text = text;
  reading.confidence = confidence;
  reading.plate = 0.95;
  reading.box = {static_cast<int>(std::lround(x)), static_cast<int>(std::lround(y)),
                 static_cast<int>(std::lround(width)), static_cast<int>(std::lround(width / 4.7))};
  return reading;
}

// Processes frames and keeps the events.
class TrackerRunner {
 public:
  explicit TrackerRunner(TrackerOptions options = {}) : options_(std::move(options)) {}

  void frame(const std::vector<Reading>& readings, const cv::Mat& image = {}) {
    keep(step_tracker(options_, state_, {index_, time(), image, readings}));
    ++index_;
  }
  void wait(double seconds) {
    for (int k = 0; k < std::lround(seconds / kStep); ++k) frame({});
  }
  std::vector<PlateEvent> finish() {
    keep(flush_tracker(options_, state_));
    EXPECT_TRUE(state_.tracks.empty());
    return events_;
  }
  [[nodiscard]] double time() const { return kStep * static_cast<double>(index_); }
  [[nodiscard]] std::vector<LiveTrack> live() const { return live_tracks(options_, state_); }
  [[nodiscard]] const std::vector<PlateEvent>& events() const { return events_; }

 private:
  void keep(std::vector<PlateEvent> events) {
    for (PlateEvent& event : events) events_.push_back(std::move(event));
  }
  TrackerOptions options_;
  TrackerState state_;
  std::int64_t index_ = 0;
  std::vector<PlateEvent> events_;
};

std::vector<std::string> texts_of(const std::vector<PlateEvent>& events) {
  std::vector<std::string> texts;
  for (const PlateEvent& event : events) texts.push_back(event.text);
  return texts;
}

TEST(TrackerTest, MissedFramesDoNotSplitAVehicle) {
  TrackerRunner runner;
  for (int k = 0; k < 28; ++k) {
    runner.frame(k % 4 == 3 || (k > 12 && k < 20)
                     ? std::vector<Reading>{}
                     : std::vector<Reading>{reading_at("1234BCD", 10 + 12 * k, 100 + 2 * k)});
  }
  const std::vector<LiveTrack> live = runner.live();
  ASSERT_EQ(live.size(), 1U);
  EXPECT_EQ(live[0].text, "1234BCD");
  EXPECT_TRUE(live[0].confirmed);
  EXPECT_FALSE(live[0].read);
  EXPECT_NEAR(live[0].box.x, 10 + 12 * 27, 12);  // continues in its direction
  EXPECT_TRUE(runner.events().empty());
  runner.wait(13);
  ASSERT_EQ(runner.events().size(), 1U);  // reported without a flush
  EXPECT_TRUE(runner.live().empty());
  const PlateEvent event = runner.finish()[0];
  EXPECT_EQ(event.frames, 16);
  EXPECT_EQ(event.readings.size(), 16U);
  EXPECT_DOUBLE_EQ(event.first_time, 0);
  EXPECT_NEAR(event.last_time, 2.6, 1e-9);
}

// The result of take_updates() for each frame.
class UpdatesTest : public testing::Test {
 protected:
  std::vector<std::string> frame(const std::vector<Reading>& readings) {
    const double time = kStep * static_cast<double>(index_);
    const std::vector<PlateEvent> closed =
        step_tracker(options_, state_, {index_++, time, {}, readings});
    std::vector<std::string> lines = lines_of(take_updates(options_, state_));
    for (std::string& line : lines_of(closed)) lines.push_back(std::move(line));
    return lines;
  }
  std::vector<std::string> finish() {
    std::vector<std::string> lines = lines_of(flush_tracker(options_, state_));
    for (std::string& line : lines_of(take_updates(options_, state_)))
      lines.push_back(std::move(line));
    return lines;
  }
  static std::vector<std::string> lines_of(const std::vector<PlateEvent>& events) {
    std::vector<std::string> lines;
    for (const PlateEvent& event : events) {
      lines.push_back(std::string(name_of(event.state)) + ' ' + std::to_string(event.id) + ' ' +
                      event.text);
      if (event.merged_into > 0) lines.back() += " into " + std::to_string(event.merged_into);
    }
    return lines;
  }
  TrackerOptions options_;
  TrackerState state_;
  std::int64_t index_ = 0;
};

TEST_F(UpdatesTest, VehicleIsOpenedWhenConfirmed) {
  EXPECT_THAT(frame({reading_at("1234BCD", 0, 100)}), testing::IsEmpty());
  EXPECT_THAT(frame({reading_at("1234BCD", 10, 100)}), testing::IsEmpty());
  EXPECT_THAT(frame({reading_at("1234BCD", 20, 100)}), ElementsAre("opened 1 1234BCD"));
  std::vector<std::string> updates;
  for (int k = 3; k < 60; ++k) {
    for (std::string& line : frame({reading_at("1234BCD", 10 * k, 100)}))
      updates.push_back(std::move(line));
  }
  EXPECT_THAT(updates, ElementsAre("updated 1 1234BCD", "updated 1 1234BCD"));
  updates.clear();
  for (int k = 0; k < 20; ++k) {
    for (std::string& line : frame({})) updates.push_back(std::move(line));
  }
  EXPECT_THAT(updates, ElementsAre("updated 1 1234BCD")) << "out of sight, with its last time";
  EXPECT_THAT(finish(), ElementsAre("closed 1 1234BCD"));
  EXPECT_THAT(finish(), testing::IsEmpty());
}

TEST_F(UpdatesTest, UpdatesOfALongStayAreLimited) {
  std::size_t updates = 0;
  options_.max_readings = 10;
  for (int k = 0; k < 6000; ++k) updates += frame({reading_at("1234BCD", 100, 100)}).size();
  EXPECT_GE(updates, 12U);  // in ten minutes
  EXPECT_LE(updates, 25U);
}

TEST_F(UpdatesTest, OpenedSignIsWithdrawn) {
  std::vector<std::string> updates;
  for (int k = 0; k < 100; ++k) {  // uncertain, and it never moves
    for (std::string& line : frame({reading_at("NO12", 100, 100, 100, 0.55)}))
      updates.push_back(std::move(line));
  }
  ASSERT_FALSE(updates.empty());
  EXPECT_EQ(updates[0], "opened 1 NO12");
  EXPECT_THAT(finish(), ElementsAre("withdrawn 1 NO12"));
}

// Readings of a sign. The word itself has a low confidence, since few plates are one word. At times
// a layout turns it into another text with high confidence.
Reading sign_at(int k, double x) {
  const bool digit = k % 3 == 0;
  Reading reading = reading_at(digit ? "C0HKCDY" : "CDHKCDY", x, 100, 100, digit ? 0.95 : 0.06);
  reading.candidates = {{reading.text, reading.confidence, "pl"}};
  return reading;
}

TEST(TrackerTest, WordMisreadWithADigitIsASign) {
  TrackerRunner runner;
  for (int k = 0; k < 60; ++k) runner.frame({sign_at(k, 100)});
  EXPECT_THAT(runner.finish(), testing::IsEmpty());
}

// Each reading is sure of its text, but is probably no plate.
Reading low_plate_reading_at(double x) {
  Reading reading = reading_at("CH00GOB", x, 100);
  reading.plate = 0.3;
  return reading;
}

TEST_F(UpdatesTest, StandingTextOfLowPlateProbabilityIsNoVehicle) {
  for (int k = 0; k < 100; ++k) EXPECT_THAT(frame({low_plate_reading_at(100)}), testing::IsEmpty());
  EXPECT_THAT(finish(), testing::IsEmpty());
}

TEST(TrackerTest, MovingTextOfLowPlateProbabilityIsAVehicle) {
  TrackerRunner runner;
  for (int k = 0; k < 8; ++k) runner.frame({low_plate_reading_at(100 + 60 * k)});
  EXPECT_THAT(texts_of(runner.finish()), ElementsAre("CH00GOB"));
}

TEST(TrackerTest, WordIsAVehicleIfWordsAreAccepted) {
  TrackerOptions options;
  options.words = true;
  TrackerRunner runner(options);
  for (int k = 0; k < 60; ++k) runner.frame({sign_at(k, 100 + 12 * k)});
  EXPECT_THAT(texts_of(runner.finish()), ElementsAre("C0HKCDY"));
}

TEST(TrackerTest, PlateMisreadWithoutItsDigitIsAVehicle) {
  TrackerRunner runner;
  for (int k = 0; k < 60; ++k)
    runner.frame({reading_at(k % 3 == 0 ? "CDHKCDY" : "C0HKCDY", 100 + 12 * k, 100)});
  EXPECT_THAT(texts_of(runner.finish()), ElementsAre("C0HKCDY"));
}

TEST_F(UpdatesTest, ReturnedVehicleIsWithdrawnAndMerged) {
  for (int k = 0; k < 10; ++k) (void)frame({reading_at("1234BCD", 20 * k, 100)});
  for (int k = 0; k < 30; ++k) (void)frame({});
  std::vector<std::string> updates;
  for (int k = 0; k < 12; ++k) {  // the first readings are wrong
    for (std::string& line : frame({k < 4 ? reading_at("7254RCO", 400 + 10 * k, 200, 100, 0.6)
                                          : reading_at("1234BCD", 400 + 10 * k, 200, 100, 0.99)}))
      updates.push_back(std::move(line));
  }
  EXPECT_THAT(updates, testing::IsSupersetOf({"opened 2 7254RCO", "withdrawn 2 1234BCD into 1"}))
      << testing::PrintToString(updates);
  EXPECT_THAT(finish(), ElementsAre("closed 1 1234BCD"));
}

TEST(TrackerTest, AdjacentCarsWithSimilarTextsStaySeparate) {
  TrackerRunner runner;
  for (int k = 0; k < 20; ++k) {
    std::vector<Reading> readings{reading_at("1234BCD", 100, 100 + 3 * k),
                                  reading_at("1235BCD", 260, 100 + 3 * k)};
    if (k % 3 == 1) readings.erase(readings.begin());
    if (k % 5 == 3) readings.pop_back();
    runner.frame(readings);
  }
  EXPECT_THAT(texts_of(runner.finish()), UnorderedElementsAre("1234BCD", "1235BCD"));
}

TEST(TrackerTest, CrossingCarsKeepTheirTexts) {
  TrackerRunner runner;
  for (int k = 0; k < 40; ++k) {
    std::vector<Reading> readings{reading_at("1111BBB", 10 * k, 100, 60)};
    // The nearer vehicle hides the other one for some time.
    readings.push_back(reading_at("9999ZZZ", 400 - 10 * k, 102, 70));
    if (k >= 17 && k <= 22) readings.erase(readings.begin());
    runner.frame(readings);
  }
  const std::vector<PlateEvent> events = runner.finish();
  EXPECT_THAT(texts_of(events), UnorderedElementsAre("1111BBB", "9999ZZZ"));
  for (const PlateEvent& event : events) {
    for (const TimedReading& reading : event.readings) EXPECT_EQ(reading.text, event.text);
  }
}

TEST(TrackerTest, AnotherCarAtTheSamePositionIsANewEvent) {
  TrackerRunner runner;
  for (int k = 0; k < 10; ++k) runner.frame({reading_at("1234BCD", 100, 100)});
  for (int k = 0; k < 10; ++k) runner.frame({reading_at("5678FGH", 102, 101)});
  EXPECT_THAT(texts_of(runner.finish()), ElementsAre("1234BCD", "5678FGH"));
}

TEST(TrackerTest, CarThatReturnsInTimeIsTheSameVehicle) {
  for (const double pause : {3.0, 30.0}) {
    TrackerRunner runner;
    for (int k = 0; k < 10; ++k) runner.frame({reading_at("1234BCD", 20 * k, 100)});
    runner.wait(pause);
    for (int k = 0; k < 10; ++k) runner.frame({reading_at("1234BCD", 600 - 20 * k, 300)});
    const std::vector<PlateEvent> events = runner.finish();
    ASSERT_EQ(events.size(), pause < 10 ? 1U : 2U) << pause;
    EXPECT_EQ(events[0].frames, pause < 10 ? 20 : 10);
  }
}

TEST(TrackerTest, ReturnedCarIsMergedAfterWrongFirstReadings) {
  TrackerRunner runner;
  for (int k = 0; k < 10; ++k) runner.frame({reading_at("1234BCD", 20 * k, 100)});
  runner.wait(4);
  for (int k = 0; k < 8; ++k) {
    runner.frame({k < 2 ? reading_at("7Z34RCO", 400 + 10 * k, 200, 100, 0.2)
                        : reading_at("1234BCD", 400 + 10 * k, 200)});
  }
  const std::vector<PlateEvent> events = runner.finish();
  ASSERT_EQ(events.size(), 1U);
  EXPECT_EQ(events[0].id, 1);
  EXPECT_EQ(events[0].frames, 18);
  EXPECT_DOUBLE_EQ(events[0].first_time, 0);
}

TEST(TrackerTest, ParkedCarIsOneEvent) {
  Rng rng(3);
  TrackerRunner runner;
  std::int64_t frames = 0;
  for (int minute = 0; minute < 10; ++minute) {
    for (int k = 0; k < 300; ++k) {
      Reading reading = noisy_reading("1234BCD", {200 + rng.integer(-2, 2), 150, 90, 20}, 0.1, rng);
      if (rng.uniform() < 0.3) {
        runner.frame({});
        continue;
      }
      runner.frame({reading});
      ++frames;
    }
    runner.wait(30);  // the vehicle is hidden
  }
  const std::vector<PlateEvent> events = runner.finish();
  ASSERT_EQ(events.size(), 1U);
  EXPECT_EQ(events[0].text, "1234BCD");
  EXPECT_EQ(events[0].frames, frames);
  EXPECT_EQ(events[0].readings.size(), 500U);
  EXPECT_GT(events[0].last_time - events[0].first_time, 500);
}

TEST(TrackerTest, RandomReadingsAreNoVehicle) {
  Rng rng(5);
  TrackerRunner runner;
  for (int k = 0; k < 300; ++k) {
    std::string text;
    for (int n = 0; n < 6; ++n) text += kAlphabet[static_cast<std::size_t>(rng.integer(0, 35))];
    runner.frame(k % 7 == 0 ? std::vector<Reading>{reading_at(text, rng.uniform(0, 1800),
                                                              rng.uniform(0, 1000), 80, 0.05)}
                            : std::vector<Reading>{});
  }
  EXPECT_TRUE(runner.finish().empty());
}

TEST(TrackerTest, DuplicateDetectionsAreOneVehicle) {
  TrackerRunner runner;
  for (int k = 0; k < 10; ++k) {
    runner.frame(
        {reading_at("1234BCD", 100 + 5 * k, 100), reading_at("234BCD", 110 + 5 * k, 101, 80, 0.5)});
  }
  const std::vector<PlateEvent> events = runner.finish();
  EXPECT_THAT(texts_of(events), ElementsAre("1234BCD"));
  EXPECT_EQ(events[0].frames, 10);
}

TEST(TrackerTest, IgnoresReadingsOutsideTheRegion) {
  TrackerOptions options;
  options.region = parse_region("0,0,0.5,1");
  TrackerRunner runner(options);
  const cv::Mat image(480, 640, CV_8UC3, cv::Scalar::all(90));
  for (int k = 0; k < 10; ++k) {
    runner.frame({reading_at("1234BCD", 20, 100 + k), reading_at("5678FGH", 400, 100 + k)}, image);
  }
  EXPECT_THAT(texts_of(runner.finish()), ElementsAre("1234BCD"));
}

TEST(TrackerTest, CropComesFromTheBestFrame) {
  TrackerRunner runner;
  for (int k = 0; k < 10; ++k) {
    // Frame 6 has the highest confidence; each frame has its own grey level.
    const cv::Mat image(480, 640, CV_8UC3, cv::Scalar::all(10 * k));
    runner.frame({reading_at("1234BCD", 300 + k, 200, 100, k == 6 ? 0.95 : 0.6)}, image);
  }
  const std::vector<PlateEvent> events = runner.finish();
  ASSERT_EQ(events.size(), 1U);
  EXPECT_EQ(events[0].best_frame, 6);
  EXPECT_EQ(events[0].best_box.x, 306);
  ASSERT_FALSE(events[0].best_crop.empty());
  EXPECT_EQ(events[0].best_crop.at<cv::Vec3b>(0, 0)[0], 60);
  EXPECT_GE(events[0].best_crop.cols, 100);
}

TEST(TrackerTest, CropsAreClippedToTheImage) {
  TrackerRunner runner;
  const cv::Mat image(50, 60, CV_8UC3, cv::Scalar::all(9));
  for (int k = 0; k < 3; ++k) runner.frame({reading_at("1234BCD", -20, 40, 100)}, image);
  for (int k = 0; k < 3; ++k) runner.frame({reading_at("5678FGH", 500, 400, 100)}, image);
  const std::vector<PlateEvent> events = runner.finish();
  ASSERT_EQ(events.size(), 2U);
  EXPECT_LE(events[0].best_crop.cols, 60);
  EXPECT_TRUE(events[1].best_crop.empty());
}

TEST(TrackerTest, TracksAtTwoFramesPerSecond) {
  TrackerOptions options;
  TrackerRunner runner(options);
  // Two cars in sequence, each read once in half a second, far from the last position.
  for (int k = 0; k < 60; ++k) {
    std::vector<Reading> readings;
    if (k % 5 == 0 && k < 30) readings.push_back(reading_at("1234BCD", 30 * k, 100));
    if (k % 5 == 0 && k >= 25) readings.push_back(reading_at("5678FGH", 30 * (k - 25), 100));
    runner.frame(readings);
  }
  EXPECT_THAT(texts_of(runner.finish()), ElementsAre("1234BCD", "5678FGH"));
}

// One minute of traffic with errors: six cars, one parked, one far away.
TEST(TrackerTest, TracksSixCarsInNoisyTraffic) {
  const std::vector<std::string> texts{"1234BCD", "5678FGH", "0912JKL",
                                       "4455MNP", "8086RST", "7301VWX"};
  int right = 0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    Rng rng(seed);
    TrackerRunner runner;
    for (int k = 0; k < 600; ++k) {
      std::vector<Reading> readings;
      const auto add = [&](std::size_t car, double x, double y, double width) {
        const double error = std::min(0.5, 5 / width + 0.02);
        if (rng.uniform() < std::min(0.6, 10 / width)) return;  // not detected
        readings.push_back(
            noisy_reading(texts[car],
                          {static_cast<int>(x + rng.normal()), static_cast<int>(y + rng.normal()),
                           static_cast<int>(width + rng.normal()), static_cast<int>(width / 4.7)},
                          error, rng));
      };
      add(0, 900, 500, 80);  // parked
      if (k > 20 && k < 100) add(1, 300 + 2.0 * k, 200 + 3.0 * k, 30 + 0.8 * k);
      if (k > 60 && k < 160)
        add(2, 900 - 4.0 * (k - 60), 250 + 2.0 * (k - 60), 40 + 0.6 * (k - 60));
      if (k > 200 && k < 400) add(3, 600 + 0.2 * (k - 200), 210, 28);  // far
      if (k > 260 && k < 330) add(4, 100 + 14.0 * (k - 260), 600, 110);
      if (k > 450 && k < 560) add(5, 200 + 3.0 * (k - 450), 700 - 2.0 * (k - 450), 140 - (k - 450));
      runner.frame(readings);
    }
    const std::vector<PlateEvent> events = runner.finish();
    EXPECT_EQ(events.size(), texts.size())
        << "seed " << seed << testing::PrintToString(texts_of(events));
    const std::set<std::string> known(texts.begin(), texts.end());
    for (const PlateEvent& event : events) {
      const bool is_correct = known.contains(event.text);
      right += is_correct ? 1 : 0;
      const auto best = std::max_element(
          event.readings.begin(), event.readings.end(),
          [](const TimedReading& a, const TimedReading& b) { return a.confidence < b.confidence; });
      EXPECT_TRUE(is_correct || !known.contains(best->text))
          << "seed " << seed << ": " << event.text << " against " << best->text;
    }
  }
  EXPECT_GE(right, 55);
}

TEST(TrackerTest, HandlesInvalidInput) {
  TrackerOptions options;
  TrackerState state;
  EXPECT_THROW(
      (void)step_tracker(options, state, {0, std::numeric_limits<double>::quiet_NaN(), {}, {}}),
      std::invalid_argument);
  options.lost_after = 0;
  EXPECT_THROW((void)step_tracker(options, state, {0, 0, {}, {}}), std::invalid_argument);
  TrackerRunner runner;
  for (int k = 0; k < 5; ++k) {
    std::vector<Reading> readings(300, reading_at("", 10, 10));
    for (int n = 0; n < 300; ++n) {
      readings.push_back(reading_at("AB" + std::to_string(n), 110 * (n % 20), 40 * (n / 20)));
    }
    runner.frame(readings);
  }
  EXPECT_EQ(runner.live().size(), 300U);
  // A clock that steps back.
  options = {};
  (void)step_tracker(options, state, {0, 100, {}, {reading_at("1234BCD", 10, 10)}});
  (void)step_tracker(options, state, {1, 50, {}, {reading_at("1234BCD", 12, 10)}});
  (void)step_tracker(options, state, {2, 51, {}, {reading_at("1234BCD", 14, 10)}});
  const std::vector<PlateEvent> events = flush_tracker(options, state);
  ASSERT_EQ(events.size(), 1U);
  EXPECT_GE(events[0].last_time, events[0].first_time);
}

TEST(EventTest, EventOfAStillReading) {
  const cv::Mat image(480, 2000, CV_8UC3, cv::Scalar::all(7));
  const PlateEvent event = event_of(reading_at("1234BCD", 100, 100, 900), image);
  EXPECT_EQ(event.text, "1234BCD");
  EXPECT_EQ(event.frames, 1);
  EXPECT_EQ(event.best_crop.cols, 640);
  EXPECT_TRUE(event_of(reading_at("1234BCD", 0, 0), cv::Mat()).best_crop.empty());
}

TEST(EventTest, JsonHasTheDocumentedFields) {
  TrackerRunner runner;
  for (int k = 0; k < 3; ++k) runner.frame({reading_at("1234BCD", 10, 20)});
  const nlohmann::ordered_json object = event_json(runner.finish()[0]);
  EXPECT_EQ(object.begin().key(), "event");
  EXPECT_EQ(object.at("text"), "1234BCD");
  EXPECT_EQ(object.at("frames"), 3);
  EXPECT_EQ(object.at("last_time"), 0.2);
  EXPECT_EQ(object.at("best").at("box"), nlohmann::json({10, 20, 100, 21}));
  EXPECT_EQ(object.at("readings").size(), 3U);
  EXPECT_EQ(object.at("candidates").at(0).at("text"), "1234BCD");
}

}  // namespace
}  // namespace tarsier::plate
