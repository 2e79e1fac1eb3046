// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/recorder.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/plate/tracking/log.h"
#include "tarsier/plate/tracking/tracker.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::plate {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class RecorderTest : public FolderTest {
 protected:
  static PlateEvent event_of(std::int64_t id, const std::string& text, PlateState state) {
    PlateEvent event;
    event.id = id;
    event.text = text;
    event.state = state;
    event.source = "cam";
    event.candidates = {{text, 0.9, ""}};
    event.first_seen = parse_moment("2026-05-01T12:00", {}, false, "time");
    event.last_seen = event.first_seen + std::chrono::seconds(id);
    event.best_crop = cv::Mat(20, 80, CV_8UC3, cv::Scalar(40, 120, 200));
    return event;
  }
  // Entries as "1234BCD open 12:00:01", newest first.
  [[nodiscard]] std::vector<std::string> entries() const {
    PlateLog log(path("plates.db"), DatabaseAccess::kRead);
    std::vector<std::string> found;
    log.query({}, [&](const LoggedPlate& plate) {
      found.push_back(plate.text + ' ' + std::string(logged_json(plate, "plates.db").at("state")) +
                      ' ' + moment_text(plate.last_time).substr(11, 8));
      EXPECT_TRUE(plate.has_crop) << plate.text;
      return true;
    });
    return found;
  }
};

// Another program that writes.
class Lock {
 public:
  explicit Lock(const std::string& path)
      : database_(path, {"Tarsier plate log", 0x54504C31, {"", "", ""}}, DatabaseAccess::kWrite),
        transaction_(std::in_place, database_) {}
  void release() { transaction_.reset(); }

 private:
  Database database_;
  std::optional<Transaction> transaction_;
};

TEST_F(RecorderTest, WritesOpenEntriesAtOnceAndUpdatesThem) {
  RecorderOptions options;
  options.max_wait = 60;
  PlateRecorder recorder(path("plates.db"), options);
  recorder.record(event_of(1, "1234BCD", PlateState::kOpened));
  EXPECT_THAT(entries(), ElementsAre("1234BCD open 12:00:01"));
  PlateEvent later = event_of(1, "1284BCD", PlateState::kUpdated);
  later.last_seen += std::chrono::seconds(20);
  recorder.record(later);
  recorder.record(event_of(2, "5678FGH", PlateState::kOpened));
  EXPECT_THAT(entries(), ElementsAre("1284BCD open 12:00:21", "5678FGH open 12:00:02"));
  later.state = PlateState::kClosed;
  recorder.record(later);
  recorder.record(event_of(2, "", PlateState::kWithdrawn));
  recorder.record(event_of(3, "9999ZZZ", PlateState::kClosed));
  recorder.finish();
  EXPECT_THAT(entries(), ElementsAre("1284BCD closed 12:00:21", "9999ZZZ closed 12:00:03"));
}

TEST_F(RecorderTest, OpenEntriesOfDeadProcessesBecomeInterrupted) {
  {
    PlateRecorder recorder(path("plates.db"));
    recorder.record(event_of(1, "1234BCD", PlateState::kOpened));
  }  // not finished: this process still runs
  {
    PlateLog log(path("plates.db"));
    (void)log.begin_run("another", [](const std::string& process) { return is_running(process); });
  }
  EXPECT_THAT(entries(), ElementsAre("1234BCD open 12:00:01"));
  {
    PlateLog log(path("plates.db"));
    (void)log.begin_run("another", [](const std::string&) { return false; });
  }
  EXPECT_THAT(entries(), ElementsAre("1234BCD interrupted 12:00:01"));
}

TEST_F(RecorderTest, ProcessNamesAreUnique) {
  const std::string me = process_name();
  EXPECT_TRUE(is_running(me));
  EXPECT_FALSE(is_running(me + "1")) << "the same number, started at another time";
  EXPECT_FALSE(is_running("0" + me)) << "another start of the system";
  EXPECT_FALSE(is_running(""));
}

// Reading continues while another program locks the log, and nothing is lost.
TEST_F(RecorderTest, QueuesEventsWhileTheLogIsLocked) {
  PlateRecorder recorder(path("plates.db"));
  Lock lock(path("plates.db"));
  const TrackerOptions options;
  TrackerState state;
  const auto frame = [&](int index) {
    std::vector<Reading> readings(3);
    for (int car = 0; car < 3; ++car) {
      Reading& reading = readings[static_cast<std::size_t>(car)];
      reading.text = std::to_string(1111 * (car + 1)) + "BCD";
      reading.confidence = 0.9;
      reading.box = {300 * car + 10 * index, 100, 100, 20};
    }
    const cv::Mat image(200, 1000, CV_8UC3, cv::Scalar::all(90));
    EXPECT_TRUE(
        step_tracker(options, state, {index, 0.1 * index, image, readings, {}, "cam"}).empty());
    for (const PlateEvent& event : take_updates(options, state)) recorder.record(event);
    recorder.check();
  };
  for (int k = 0; k < 8; ++k) frame(k);
  EXPECT_TRUE(entries().empty());
  for (int k = 8; k < 30; ++k) frame(k);
  lock.release();
  for (const PlateEvent& event : flush_tracker(options, state)) recorder.record(event);
  recorder.finish();
  EXPECT_THAT(entries(), testing::UnorderedElementsAre(HasSubstr("1111BCD closed"),
                                                       HasSubstr("2222BCD closed"),
                                                       HasSubstr("3333BCD closed")));
}

TEST_F(RecorderTest, LongLockIsAnError) {
  RecorderOptions options;
  options.max_lock = 0;
  options.attempt_ms = 1;
  PlateRecorder recorder(path("plates.db"), options);
  const Lock lock(path("plates.db"));
  try {
    recorder.record(event_of(1, "1234BCD", PlateState::kOpened));
    recorder.finish();
    FAIL() << "no error";
  } catch (const OutputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("plates.db: is locked by another program: 1 entry was"));
  }
  EXPECT_THROW(recorder.record(event_of(2, "5678FGH", PlateState::kOpened)), OutputError);
  EXPECT_THROW(recorder.check(), OutputError);
}

TEST_F(RecorderTest, FinishThrowsAtItsTimeout) {
  PlateRecorder recorder(path("plates.db"));
  Lock lock(path("plates.db"));
  recorder.record(event_of(1, "1234BCD", PlateState::kClosed));
  EXPECT_THROW(recorder.finish(0), OutputError);
  lock.release();
  recorder.finish();
  EXPECT_THAT(entries(), ElementsAre("1234BCD closed 12:00:01"));
}

TEST_F(RecorderTest, ShiftsEntriesOfAnUnsynchronizedClock) {
  PlateRecorder recorder(path("plates.db"));
  PlateEvent event = event_of(1, "1234BCD", PlateState::kClosed);
  recorder.record(event);
  event = event_of(2, "5678FGH", PlateState::kClosed);
  event.synchronized = false;
  recorder.record(event);
  event = event_of(3, "9999ZZZ", PlateState::kOpened);
  event.synchronized = false;
  recorder.record(event);
  recorder.shift_unsynchronized(std::chrono::hours(2));
  recorder.trust_clock();
  recorder.shift_unsynchronized(std::chrono::hours(5));  // nothing to shift
  recorder.finish();
  EXPECT_THAT(entries(), ElementsAre("9999ZZZ open 14:00:03", "5678FGH closed 14:00:02",
                                     "1234BCD closed 12:00:01"));
}

TEST_F(RecorderTest, WritesADeletedEntryAgain) {
  PlateRecorder recorder(path("plates.db"));
  recorder.record(event_of(1, "1234BCD", PlateState::kOpened));
  {
    PlateLog log(path("plates.db"), DatabaseAccess::kWrite);
    log.remove(1);
  }
  PlateEvent event = event_of(1, "1234BCD", PlateState::kClosed);
  event.best_frame = 7;
  recorder.record(event);
  recorder.finish();
  EXPECT_THAT(entries(), ElementsAre("1234BCD closed 12:00:01"));
}

TEST_F(RecorderTest, RejectsInvalidOptions) {
  RecorderOptions options;
  options.max_lock = -1;
  EXPECT_THROW(PlateRecorder(path("plates.db"), options), std::invalid_argument);
  EXPECT_THROW(PlateRecorder(path("missing/plates.db")), OutputError);
}

}  // namespace
}  // namespace tarsier::plate
