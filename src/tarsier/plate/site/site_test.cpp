// SPDX-License-Identifier: MIT
#include "tarsier/plate/site/site.h"

#include "tarsier/core/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <set>

namespace tarsier::plate {
namespace {

using testing::ElementsAre;
using testing::UnorderedElementsAre;

// Frames every 0.1 s, in which a vehicle drives by from frame `vehicle_from` to +10 frames.
class DriveBySource final : public FrameSource {
 public:
  struct Script {
    int frames = 60;
    int vehicle_from = 20;
    int fails_at = -1;  // throws SourceLostError at this frame
    bool ends = true;
  };
  explicit DriveBySource(const Script& script) : script_(script) {}

  std::optional<Frame> next(std::chrono::milliseconds, const std::stop_token&) override {
    if (at_ == script_.fails_at) throw SourceLostError("a camera", "its cable was cut");
    if (at_ >= script_.frames) return std::nullopt;
    Frame frame;
    frame.image = cv::Mat(180, 320, CV_8UC3, cv::Scalar::all(90));
    const int since = at_ - script_.vehicle_from;
    if (since >= 0 && since < 10)
      cv::rectangle(frame.image, {20 * since, 80, 60, 30}, {200, 200, 200}, cv::FILLED);
    frame.index = at_;
    frame.time = 0.1 * at_++;
    frame.captured = std::chrono::steady_clock::now();
    return frame;
  }
  [[nodiscard]] bool ended() const override { return script_.ends && at_ >= script_.frames; }
  [[nodiscard]] bool is_live() const override { return false; }
  [[nodiscard]] SourceStatus status() const override {
    SourceStatus status;
    status.state = ended() ? SourceState::kEnded : SourceState::kLive;
    status.received = at_;
    return status;
  }
  [[nodiscard]] double fps() const override { return 10; }
  [[nodiscard]] std::int64_t count() const override { return 0; }
  [[nodiscard]] const std::vector<std::string>& skipped() const override { return skipped_; }

 private:
  Script script_;
  int at_ = 0;
  std::vector<std::string> skipped_;
};

// A camera that opens itself again without success after its last frame: it ages by 5 s with each
// call, until a vehicle has been closed.
class LostSource final : public FrameSource {
 public:
  struct Watch {
    std::mutex mutex;
    std::condition_variable changed;
    bool has_closed = false;
    bool has_timed_out = false;  // before that
  };
  LostSource(const DriveBySource::Script& script, Watch& watch) : camera_(script), watch_(watch) {}

  std::optional<Frame> next(std::chrono::milliseconds timeout,
                            const std::stop_token& stop) override {
    if (auto frame = camera_.next(timeout, stop)) return frame;
    age_s_ += 5;
    std::unique_lock lock(watch_.mutex);
    watch_.changed.wait_for(lock, timeout, [&] { return watch_.has_closed; });
    watch_.has_timed_out = !watch_.has_closed && age_s_ > 500;
    ended_ = watch_.has_closed || watch_.has_timed_out;
    return std::nullopt;
  }
  [[nodiscard]] bool ended() const override { return ended_; }
  [[nodiscard]] bool is_live() const override { return false; }
  [[nodiscard]] SourceStatus status() const override {
    SourceStatus status = camera_.status();
    if (age_s_ == 0) return status;
    status.state = SourceState::kLost;
    status.age_s = age_s_;
    status.reopened = 2;
    return status;
  }
  [[nodiscard]] double fps() const override { return camera_.fps(); }
  [[nodiscard]] std::int64_t count() const override { return 0; }
  [[nodiscard]] const std::vector<std::string>& skipped() const override {
    return camera_.skipped();
  }

 private:
  DriveBySource camera_;
  Watch& watch_;
  double age_s_ = 0;
  bool ended_ = false;
};

// Reads the white plate of a DriveBySource as `text`.
VideoReader reader_of(const std::string& text) {
  return {[text](const Frame& frame, DebugSink*) {
            cv::Mat gray;
            cv::cvtColor(frame.image, gray, cv::COLOR_BGR2GRAY);
            const cv::Rect box = cv::boundingRect(gray > 150);
            ReaderResult result;
            if (box.empty()) return result;
            Reading reading;
            reading.text = text;
            reading.confidence = 0.9;
            reading.plate = 0.95;
            reading.box = box;
            reading.candidates.push_back({text, 0.9, ""});
            result.plates.push_back(reading);
            return result;
          },
          {}};
}

class SiteTest : public testing::Test {
 protected:
  SiteTest() {
    options_.restart = 0.001;
    options_.max_restart = 0.001;
    handlers_.events = [this](std::size_t, const std::vector<PlateEvent>& events) {
      for (const PlateEvent& event : events) {
        if (event.state != PlateState::kClosed) continue;
        closed_.push_back(event.text + "@" + event.source);
        ids_.insert(event.id);
      }
    };
  }
  void add(const std::string& name, const DriveBySource::Script& script) {
    cameras_.push_back({name, [script] { return std::make_unique<DriveBySource>(script); },
                        reader_of("4725" + name)});
  }
  std::vector<CameraReport> run() {
    return run_site(cameras_, options_, handlers_, stop_.get_token());
  }

  std::vector<SiteCamera> cameras_;
  SiteOptions options_;
  SiteHandlers handlers_;
  std::stop_source stop_;
  std::vector<std::string> closed_;
  std::set<std::int64_t> ids_;
};

TEST_F(SiteTest, OneEventPerVehicleWithAnyNumberOfThreads) {
  for (const int threads : {1, 3}) {
    options_.threads = threads;
    closed_.clear();
    ids_.clear();
    cameras_.clear();
    for (int i = 1; i <= 5; ++i) add(std::to_string(i), {60, 5 * i});
    run();
    EXPECT_THAT(closed_,
                UnorderedElementsAre("47251@1", "47252@2", "47253@3", "47254@4", "47255@5"));
    EXPECT_EQ(ids_.size(), 5U);  // of all cameras
  }
}

TEST_F(SiteTest, ReadsFewFramesWithoutMotion) {
  add("a", {300, 200});
  const CameraReport report = run().at(0);
  EXPECT_EQ(report.received, 300);
  EXPECT_EQ(report.examined, 300);
  EXPECT_THAT(closed_, ElementsAre("4725a@a"));
  EXPECT_EQ(report.vehicles, 1);
  // Frames that are read: two seconds at the start, three seconds with the vehicle plus the
  // adaptation of the background, and one frame per second.
  EXPECT_LT(report.read, 120);
  EXPECT_GT(report.read, 60);
  options_.motion.threshold = 0;
  EXPECT_EQ(run().at(0).read, 300);
}

TEST_F(SiteTest, ReadsTheRegionOfMotionAndSometimesTheWholeFrame) {
  std::mutex mutex;
  std::vector<cv::Rect> parts;
  const VideoReader whole = reader_of("4725BKZ");
  cameras_.push_back(
      {"a",
       [] {
         return std::make_unique<DriveBySource>(DriveBySource::Script{80, 40});
       },
       {VideoReader::ReadPart([&](const Frame& frame, const cv::Rect& region, DebugSink*) {
          const cv::Rect all(0, 0, frame.image.cols, frame.image.rows);
          const cv::Rect visible = region.empty() ? all : region;
          const std::lock_guard lock(mutex);
          parts.push_back(region);
          Frame part = frame;
          part.image = cv::Mat(frame.image.size(), CV_8UC3, cv::Scalar::all(90));
          frame.image(visible).copyTo(part.image(visible));
          VideoReaderState state;
          ReaderResult result;
          result.plates = whole.process(part, state).plates;
          return result;
        }),
        {}}});
  const CameraReport report = run().at(0);
  EXPECT_THAT(closed_, ElementsAre("4725BKZ@a"));  // no part of the vehicle lies outside
  const auto partial_reads =
      std::count_if(parts.begin(), parts.end(), [](const cv::Rect& part) { return !part.empty(); });
  EXPECT_EQ(report.read_partially, partial_reads);
  EXPECT_GT(partial_reads, 10);
  EXPECT_LT(partial_reads, report.read);
  for (const cv::Rect& part : parts) EXPECT_LE(part.area(), 0.6 * 320 * 180);
}

TEST_F(SiteTest, ReopensAFailedCameraWhileOthersContinue) {
  std::atomic<int> opened = 0;
  std::atomic<int> closed = 0;
  handlers_.events = [&, collect = handlers_.events](std::size_t camera,
                                                     const std::vector<PlateEvent>& events) {
    collect(camera, events);
    if (camera == 0 && events.back().state == PlateState::kClosed) ++closed;
  };
  cameras_.push_back({"bad",
                      [&]() -> std::unique_ptr<FrameSource> {
                        const int attempt = opened++;
                        EXPECT_EQ(closed, attempt == 0 ? 0 : 1);  // its view has ended
                        if (attempt == 1) throw InputError("bad", "no such camera");
                        return std::make_unique<DriveBySource>(
                            DriveBySource::Script{60, 10, attempt == 0 ? 40 : -1, true});
                      },
                      reader_of("BAD1")});
  add("good", {60, 10});
  std::vector<std::string> lost;
  handlers_.source = [&](std::size_t camera, const SourceStatus& status) {
    if (status.state == SourceState::kLost) lost.push_back(std::to_string(camera) + status.detail);
  };
  const std::vector<CameraReport> reports = run();
  EXPECT_EQ(opened, 3);
  EXPECT_EQ(reports[0].restarts, 2);
  EXPECT_EQ(reports[1].restarts, 0);
  EXPECT_THAT(lost, ElementsAre("0a camera: its cable was cut", "0bad: no such camera"));
  // Before and after the cable was cut.
  EXPECT_THAT(closed_, UnorderedElementsAre("BAD1@bad", "BAD1@bad", "4725good@good"));
}

TEST_F(SiteTest, ClosesTheVehiclesOfALostCamera) {
  LostSource::Watch watch;
  cameras_.push_back(
      {"a",
       [&] {
         return std::make_unique<LostSource>(DriveBySource::Script{26, 20, -1, false}, watch);
       },
       reader_of("4725BKZ")});
  handlers_.events = [&, collect = handlers_.events](std::size_t camera,
                                                     const std::vector<PlateEvent>& events) {
    collect(camera, events);
    const std::lock_guard lock(watch.mutex);
    watch.has_closed = !closed_.empty();
    watch.changed.notify_all();
  };
  EXPECT_EQ(run().at(0).restarts, 2);
  EXPECT_FALSE(watch.has_timed_out);
  EXPECT_THAT(closed_, ElementsAre("4725BKZ@a"));
}

TEST_F(SiteTest, ClosesOpenVehiclesWhenStopped) {
  add("a", {45, 30, -1, false});  // and never ends
  handlers_.events = [&, closed = handlers_.events](std::size_t camera,
                                                    const std::vector<PlateEvent>& events) {
    closed(camera, events);
    if (events.front().state == PlateState::kOpened) stop_.request_stop();
  };
  run();
  EXPECT_THAT(closed_, ElementsAre("4725a@a"));
}

TEST_F(SiteTest, RethrowsTheExceptionOfAHandler) {
  add("a", {});
  add("b", {100, 20, -1, false});
  handlers_.events = [](std::size_t, const std::vector<PlateEvent>&) {
    throw OutputError("plates.db", "the disk is full");
  };
  EXPECT_THROW(run(), OutputError);
  cameras_.clear();
  EXPECT_THROW(run(), std::invalid_argument);
}

// The frames of the two cameras are read in any order. Each vehicle stays in sight until its source
// ends. The clock is set when one source may have ended.
TEST_F(SiteTest, ClockStepShiftsTheTimesOfAllCameras) {
  add("a", {30, 20});
  add("b", {30, 20});
  int call_count = 0;
  handlers_.moment = [&](const Frame&) {
    constexpr int kBefore = 50;
    SiteMoment moment;
    moment.frame_moment.synchronized = call_count >= kBefore;
    moment.frame_moment.wall = Moment(std::chrono::hours(call_count >= kBefore ? 1000 : 0));
    if (call_count++ == kBefore) moment.step = std::chrono::hours(1000);
    return moment;
  };
  options_.motion.threshold = 0;
  std::vector<Moment> last_seen_times;
  handlers_.events = [&](std::size_t, const std::vector<PlateEvent>& events) {
    for (const PlateEvent& event : events)
      if (event.state == PlateState::kClosed) last_seen_times.push_back(event.last_seen);
  };
  run();
  EXPECT_THAT(last_seen_times,
              ElementsAre(Moment(std::chrono::hours(1000)), Moment(std::chrono::hours(1000))));
}

}  // namespace
}  // namespace tarsier::plate
