// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/source_clock.h"

#include "tarsier/plate/tracking/testing_moment.h"
#include "tarsier/plate/tracking/tracker.h"

#include <gtest/gtest.h>

#include <optional>
#include <stdexcept>
#include <vector>

namespace tarsier::plate {
namespace {

using std::chrono::milliseconds;

// A machine whose clocks stand still unless the test moves them.
struct FakeMachine {
  Moment wall = moment_at("2026-05-01T12:00");
  milliseconds uptime{100'000};
  std::chrono::steady_clock::time_point steady{std::chrono::seconds(5000)};
  bool synchronized = true;

  [[nodiscard]] Clocks clocks() {
    return {[this] { return wall; }, [this] { return uptime; }, [this] { return steady; },
            [this] { return synchronized; }};
  }
  void pass(milliseconds time) {
    wall += time;
    uptime += time;
    steady += time;
  }
};

TEST(SourceClockTest, LiveFrameHasItsTimeOfArrival) {
  FakeMachine machine;
  SourceClock clock(machine.clocks());
  clock.begin({}, 0);
  EXPECT_EQ(clock.at(0, machine.steady).wall, moment_at("2026-05-01T12:00"));
  machine.pass(milliseconds(2500));
  // The frame arrived 300 ms ago.
  const FrameMoment moment = clock.at(2.2, machine.steady - milliseconds(300));
  EXPECT_EQ(moment.wall, moment_at("2026-05-01T12:00:02.200"));
  EXPECT_EQ(moment.uptime, milliseconds(102'200));
  EXPECT_TRUE(moment.synchronized);
  EXPECT_EQ(clock.take_step(), std::nullopt);
}

TEST(SourceClockTest, DetectsStepsButNotDrift) {
  FakeMachine machine;
  machine.synchronized = false;
  machine.wall = moment_at("2026-01-01");
  SourceClock clock(machine.clocks());
  clock.begin({}, 0);
  EXPECT_FALSE(clock.at(0, machine.steady).synchronized);
  machine.pass(std::chrono::hours(24));
  machine.wall += milliseconds(5000);  // 58 ppm
  (void)clock.at(86400, machine.steady);
  EXPECT_EQ(clock.take_step(), std::nullopt);
  machine.pass(milliseconds(100));
  machine.wall += std::chrono::hours(1000);
  machine.synchronized = true;
  EXPECT_TRUE(clock.at(86400.1, machine.steady).synchronized);
  EXPECT_EQ(clock.take_step(), std::optional<milliseconds>(std::chrono::hours(1000)));
  EXPECT_EQ(clock.take_step(), std::nullopt);
  machine.pass(milliseconds(100));
  machine.wall -= milliseconds(3000);
  (void)clock.at(86400.2, machine.steady);
  EXPECT_EQ(clock.take_step(), std::optional<milliseconds>(-3000));
}

TEST(SourceClockTest, SuspendIsNoStep) {
  FakeMachine machine;
  SourceClock clock(machine.clocks());
  clock.begin({}, 0);
  (void)clock.at(0, machine.steady);
  machine.wall += std::chrono::hours(8);
  machine.uptime += std::chrono::hours(8);  // the steady clock stood still
  EXPECT_EQ(clock.at(1, machine.steady).uptime, milliseconds(100'000) + std::chrono::hours(8));
  EXPECT_EQ(clock.take_step(), std::nullopt);
}

TEST(SourceClockTest, ClockBefore2024IsUnsynchronized) {
  FakeMachine machine;
  machine.wall = moment_at("2023-12-31T23:59");
  SourceClock clock(machine.clocks());
  clock.begin({}, 0);
  EXPECT_FALSE(clock.at(0, machine.steady).synchronized);
  EXPECT_FALSE(is_plausible(moment_at("1970-01-01")));
  EXPECT_TRUE(is_plausible(moment_at("2024-01-01")));
}

TEST(SourceClockTest, RecordingStartsAtItsOwnTime) {
  FakeMachine machine;
  const Moment start =
      recording_start(moment_at("2026-04-01T10:10"), std::chrono::minutes(10), machine.wall);
  EXPECT_EQ(start, moment_at("2026-04-01T10:00"));
  EXPECT_EQ(recording_start(moment_at("2030-01-01"), std::chrono::minutes(10), machine.wall),
            moment_at("2026-05-01T11:50"))
      << "no recording comes from the future";
  SourceClock clock(machine.clocks());
  // The second of two files; its times continue those of the first.
  clock.begin({false, start}, 40);
  EXPECT_EQ(clock.at(40, machine.steady).wall, moment_at("2026-04-01T10:00"));
  machine.wall += std::chrono::hours(1);  // has no effect here
  const FrameMoment moment = clock.at(100.5, machine.steady);
  EXPECT_EQ(moment.wall, moment_at("2026-04-01T10:01:00.500"));
  EXPECT_EQ(moment.uptime, milliseconds(60'500));
}

TEST(SourceClockTest, RecordingOfUnknownTimeKeepsItsDurations) {
  FakeMachine machine;
  SourceClock clock(machine.clocks());
  clock.begin({false, std::nullopt}, 0);
  (void)clock.at(0, machine.steady);
  machine.pass(milliseconds(100));  // read a hundred times faster than real time
  const FrameMoment moment = clock.at(10, machine.steady);
  EXPECT_EQ(moment.wall, machine.wall);
  EXPECT_EQ(moment.uptime, milliseconds(10'000));
}

TEST(SourceClockTest, RejectsMissingClocks) {
  EXPECT_THROW(SourceClock({}), std::invalid_argument);
  const Clocks clocks = system_clocks();
  EXPECT_LE(clocks.uptime(), clocks.uptime());
  (void)clocks.synchronized();
  EXPECT_TRUE(is_plausible(clocks.wall()));
}

// A vehicle in front of a camera while NTP sets the clock.
class SetClock : public testing::TestWithParam<std::chrono::hours> {};

TEST_P(SetClock, EventsKeepTheirDurationAndEndTime) {
  FakeMachine machine;
  machine.synchronized = false;
  SourceClock clock(machine.clocks());
  clock.begin({}, 0);
  const TrackerOptions options;
  TrackerState state;
  Reading reading;
  reading.text = "1234BCD";
  reading.confidence = 0.9;
  std::vector<PlateEvent> updates;
  const auto frame = [&](int index, int x) {
    machine.pass(milliseconds(100));
    reading.box = {x, 100, 100, 20};
    TrackedFrame tracked{index, 0.1 * index, {}, {reading}, {}, "cam"};
    tracked.moment = clock.at(tracked.time, machine.steady);
    if (const auto step = clock.take_step()) shift_unsynchronized(state, *step);
    EXPECT_TRUE(step_tracker(options, state, tracked).empty());
    for (PlateEvent& event : take_updates(options, state)) updates.push_back(std::move(event));
  };
  for (int k = 0; k < 20; ++k) frame(k, 10 * k);
  ASSERT_FALSE(updates.empty());
  EXPECT_EQ(updates[0].state, PlateState::kOpened);
  EXPECT_EQ(updates[0].first_seen, moment_at("2026-05-01T12:00:00.100"));
  machine.wall += GetParam();
  machine.synchronized = true;
  for (int k = 20; k < 40; ++k) frame(k, 10 * k);
  const std::vector<PlateEvent> closed = flush_tracker(options, state);
  ASSERT_EQ(closed.size(), 1U);
  EXPECT_EQ(closed[0].last_seen, machine.wall);
  EXPECT_EQ(closed[0].last_seen - closed[0].first_seen, milliseconds(3900));
  EXPECT_TRUE(closed[0].synchronized);
  EXPECT_EQ(closed[0].source, "cam");
}
INSTANTIATE_TEST_SUITE_P(ForwardAndBack, SetClock,
                         testing::Values(std::chrono::hours(960), std::chrono::hours(-3)));

}  // namespace
}  // namespace tarsier::plate
