// SPDX-License-Identifier: MIT
#include "tarsier/plate/site/site.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/plate/site/fair_scheduler.h"

#include <algorithm>
#include <condition_variable>
#include <ctime>
#include <exception>
#include <map>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

namespace tarsier::plate {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr milliseconds kFrameTimeout{100};
// Idle periods after which a frame without motion has to wait no longer.
constexpr double kMaxIdleWaits = 10;
// Idle periods between frames without motion and without plates.
constexpr double kIdleFactorWithoutPlates = 4;
constexpr int kMinPartialReads =
    4;  // minimum number of frames read in part between two whole frames
constexpr double kMaxPartialShare = 0.6;  // share of a frame from which the whole frame is read

Clock::duration seconds(double s) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(s));
}

// Of this thread only.
double cpu_seconds() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

class Site {
 public:
  Site(const std::vector<SiteCamera>& cameras, const SiteOptions& options,
       const SiteHandlers& handlers, const std::stop_token& stop)
      : options_(options),
        handlers_(handlers),
        scheduler_(cameras.size()),
        feeding_(cameras.size()),
        forward_stop_(stop, [this] { end(); }) {
    for (const SiteCamera& camera : cameras) {
      cameras_.push_back(std::make_unique<Camera>());
      cameras_.back()->config = &camera;
      cameras_.back()->report.name = camera.name;
    }
  }

  std::vector<CameraReport> run() {
    {
      std::vector<std::jthread> threads;  // joined at the end of the block
      for (std::size_t i = 0; i < cameras_.size(); ++i) {
        threads.emplace_back([this, i] { guarded([&] { feed(i); }, true); });
      }
      for (int i = 0; i < options_.threads; ++i) {
        threads.emplace_back([this] { guarded([&] { work(); }, false); });
      }
    }
    if (error_) std::rethrow_exception(error_);
    std::vector<CameraReport> reports;
    for (std::size_t i = 0; i < cameras_.size(); ++i) {
      Camera& camera = *cameras_[i];
      shift_unsynchronized(camera.state.tracker, camera.step);  // since its last frame
      report_events(i, camera.config->reader.finish(camera.state));
      reports.push_back(camera.report);
    }
    return reports;
  }

 private:
  struct Camera {
    const SiteCamera* config = nullptr;
    std::optional<Frame> waiting;
    bool waiting_has_motion = false;  // the waiting frame shows motion
    cv::Rect waiting_region;          // of the motion; empty: the whole frame is read
    double read_time = 0;             // time of the latest frame taken for reading, s
    double whole_time = 0;            // time of the latest one that was read whole
    int partial_reads = 0;            // frames read in part since then
    bool plates_in_view = true;       // plates were in view, or none was searched yet
    bool has_failed = false;          // all vehicles are closed after the waiting frame
    // The source is lost and has sent no frame until this time, s.
    std::optional<double> silent_until;
    milliseconds step{0};    // step of the wall clock since its last frame was read
    VideoReaderState state;  // owned by the thread that serves the camera
    std::map<std::int64_t, std::int64_t> ids;  // vehicle ids: the tracker's -> the site's
    CameraReport report;
  };

  // An exception ends the run.
  template <class Work>
  void guarded(const Work& work, bool feeds) {
    try {
      work();
    } catch (...) {
      const std::lock_guard lock(mutex_);
      if (!error_) error_ = std::current_exception();
      stop_.request_stop();
    }
    const std::lock_guard lock(mutex_);
    if (feeds) --feeding_;
    changed_.notify_all();
  }

  void end() {
    const std::lock_guard lock(mutex_);
    stop_.request_stop();
    changed_.notify_all();
  }

  [[nodiscard]] bool stopped() const { return stop_.stop_requested(); }

  // --- frames ---

  void feed(std::size_t index) {
    Camera& camera = *cameras_[index];
    double wait_s = options_.restart;
    while (!stopped()) {
      const Clock::time_point start = Clock::now();
      std::string reason;
      try {
        feed_from(index);
        return;
      } catch (const InputError& error) {
        reason = error.what();
      } catch (const SourceLostError& error) {
        reason = error.what();
      }
      if (Clock::now() - start > seconds(options_.max_restart)) wait_s = options_.restart;
      log_warning("{}; it is opened again in {:.0f} s", reason, wait_s);
      SourceStatus status;
      status.state = SourceState::kLost;
      status.detail = reason;
      report_source(index, status);
      {
        std::unique_lock lock(mutex_);
        ++camera.report.restarts;
        // The times of a reopened source start again.
        camera.has_failed = true;
        scheduler_.offer(index, false);
        changed_.notify_all();
        changed_.wait(lock, [&] { return stopped() || !camera.has_failed; });
      }
      sleep_unless_stopped(std::chrono::duration_cast<milliseconds>(seconds(wait_s)),
                           stop_.get_token());
      wait_s = std::min(2 * wait_s, options_.max_restart);
    }
  }

  // Runs until the source ends or the run is stopped.
  void feed_from(std::size_t index) {
    Camera& camera = *cameras_[index];
    const std::unique_ptr<FrameSource> source = camera.config->open();
    const bool live = source->is_live();
    const CameraReport before = camera.report;
    MotionState motion;
    std::optional<SourceState> last_state;
    Clock::time_point next_examination{};
    double last_motion = 0;  // time of the frame, s
    double last_time = 0;    // of the newest frame, s
    bool is_first = true;
    while (!stopped()) {
      if (live) sleep_until(next_examination);
      std::optional<Frame> frame = source->next(kFrameTimeout, stop_.get_token());
      const SourceStatus status = source->status();
      if (status.state != last_state) {
        last_state = status.state;
        report_source(index, status);
      }
      {
        const std::lock_guard lock(mutex_);
        camera.report.received = before.received + status.received;
        camera.report.restarts = before.restarts + status.reopened;
      }
      if (!frame) {
        if (source->ended()) return;
        if (!is_first && status.state != SourceState::kLive)
          offer_silence(index, last_time + status.age_s);
        continue;
      }
      last_time = frame->time;
      next_examination = std::max(next_examination + seconds(1 / options_.max_fps), Clock::now());
      frame->name = camera.config->name;
      frame->still = false;
      const bool moves = has_motion(options_.motion, motion, frame->image, frame->time);
      if (moves || is_first) last_motion = frame->time;
      const bool holds = frame->time - last_motion <= options_.hold;

      std::unique_lock lock(mutex_);
      if (is_first) camera.read_time = camera.whole_time = frame->time;
      is_first = false;
      ++camera.report.examined;
      if (holds) ++camera.report.moving;
      const double waited = frame->time - camera.read_time;
      if (!holds && waited < options_.idle * (camera.plates_in_view ? 1 : kIdleFactorWithoutPlates))
        continue;
      if (!live) changed_.wait(lock, [&] { return stopped() || !camera.waiting; });
      // Keeps a waiting frame with motion: a vehicle may drive by while other cameras are read.
      if (camera.waiting && camera.waiting_has_motion && !moves) continue;
      const bool is_low_priority = !moves && waited < kMaxIdleWaits * options_.idle;
      camera.waiting = std::move(*frame);
      camera.waiting_has_motion = moves;
      camera.waiting_region = holds ? motion_region_of(motion, *camera.waiting) : cv::Rect();
      scheduler_.offer(index, is_low_priority);
      changed_.notify_all();
    }
  }

  void offer_silence(std::size_t index, double until) {
    const std::lock_guard lock(mutex_);
    cameras_[index]->silent_until = until;
    scheduler_.offer(index, false);
    changed_.notify_all();
  }

  // The region of recent motion; empty if that is most of the frame.
  [[nodiscard]] cv::Rect motion_region_of(const MotionState& motion, const Frame& frame) const {
    if (options_.motion.threshold <= 0) return {};
    const cv::Rect part = motion_box(motion, frame.time - options_.hold, frame.image.size());
    return part.area() > kMaxPartialShare * static_cast<double>(frame.image.total()) ? cv::Rect()
                                                                                     : part;
  }

  void sleep_until(Clock::time_point due) {
    const auto left = std::chrono::duration_cast<milliseconds>(due - Clock::now());
    if (left > milliseconds(0)) sleep_unless_stopped(left, stop_.get_token());
  }

  // --- reading ---

  void work() {
    std::unique_lock lock(mutex_);
    while (true) {
      std::optional<std::size_t> next;
      changed_.wait(lock, [&] {
        if (!stopped()) next = scheduler_.take();
        return next || stopped() || (feeding_ == 0 && !has_waiting());
      });
      if (!next) return;
      const Camera& camera = *cameras_[*next];
      double cost = 0;
      if (camera.waiting) cost = read_waiting(*next, lock);
      if (camera.has_failed || camera.silent_until) close_lost(*next, lock);
      scheduler_.done(*next, cost);
      changed_.notify_all();
    }
  }

  // Reads the waiting frame of a camera that is being served; returns the processor time, s.
  double read_waiting(std::size_t index, std::unique_lock<std::mutex>& lock) {
    Camera& camera = *cameras_[index];
    const Frame frame = std::move(*camera.waiting);
    camera.waiting.reset();
    camera.read_time = frame.time;
    // Standing vehicles are read at intervals, too.
    const bool is_whole =
        camera.waiting_region.empty() || (frame.time - camera.whole_time >= options_.idle &&
                                          camera.partial_reads >= kMinPartialReads);
    const cv::Rect part = is_whole ? cv::Rect() : camera.waiting_region;
    camera.partial_reads = is_whole ? 0 : camera.partial_reads + 1;
    if (is_whole) camera.whole_time = frame.time;
    const milliseconds step = std::exchange(camera.step, milliseconds(0));
    changed_.notify_all();
    lock.unlock();
    const double start = cpu_seconds();
    const bool plates_in_view = read(index, frame, part, step);
    const double cost = cpu_seconds() - start;
    lock.lock();
    camera.report.cpu_s += cost;
    if (!is_whole) ++camera.report.read_partially;
    camera.plates_in_view = plates_in_view || (!is_whole && camera.plates_in_view);
    ++camera.report.read;
    return cost;
  }

  // Closes the vehicles that have left a camera whose source is lost; all if it has failed.
  void close_lost(std::size_t index, std::unique_lock<std::mutex>& lock) {
    Camera& camera = *cameras_[index];
    const VideoReader& reader = camera.config->reader;
    const bool has_failed = camera.has_failed;
    const std::optional<double> until = std::exchange(camera.silent_until, std::nullopt);
    const milliseconds step = std::exchange(camera.step, milliseconds(0));
    lock.unlock();
    shift_unsynchronized(camera.state.tracker, step);
    report_events(index, has_failed ? reader.finish(camera.state)
                                    : reader.process_silence(*until, camera.state).events);
    lock.lock();
    if (has_failed) camera.has_failed = false;
  }

  [[nodiscard]] bool has_waiting() const {
    return std::any_of(cameras_.begin(), cameras_.end(),
                       [](const auto& camera) { return camera->waiting.has_value(); });
  }

  // Returns whether plates are in view.
  bool read(std::size_t index, const Frame& frame, const cv::Rect& part, milliseconds step) {
    Camera& camera = *cameras_[index];
    const VideoReader& reader = camera.config->reader;
    shift_unsynchronized(camera.state.tracker, step);
    const FrameMoment moment = moment_of(index, frame);
    VideoReaderResult result = reader.process(frame, camera.state, moment, nullptr, part);
    report_events(index, std::move(result.events));
    return !result.plates.empty() || !result.tracks.empty();
  }

  FrameMoment moment_of(std::size_t index, const Frame& frame) {
    if (!handlers_.moment) return {};
    const std::lock_guard handlers_lock(handlers_mutex_);
    const SiteMoment moment = handlers_.moment(frame);
    if (moment.step.count() != 0) {
      shift_unsynchronized(cameras_[index]->state.tracker, moment.step);
      const std::lock_guard lock(mutex_);
      for (std::size_t i = 0; i < cameras_.size(); ++i)
        if (i != index) cameras_[i]->step += moment.step;
    }
    return moment.frame_moment;
  }

  // --- reports ---

  void report_events(std::size_t index, std::vector<PlateEvent> events) {
    if (events.empty()) return;
    Camera& camera = *cameras_[index];
    const std::lock_guard handlers_lock(handlers_mutex_);
    for (PlateEvent& event : events) {
      if (event.merged_into != 0) event.merged_into = site_id(camera, event.merged_into);
      const std::int64_t own = event.id;
      event.id = site_id(camera, own);
      if (event.state == PlateState::kClosed) ++camera.report.vehicles;
      if (event.state == PlateState::kClosed || event.state == PlateState::kWithdrawn)
        camera.ids.erase(own);
    }
    if (handlers_.events) handlers_.events(index, events);
  }

  std::int64_t site_id(Camera& camera, std::int64_t own) {
    const auto [entry, is_new] = camera.ids.emplace(own, next_id_);
    if (is_new) ++next_id_;
    return entry->second;
  }

  void report_source(std::size_t index, const SourceStatus& status) {
    const std::lock_guard handlers_lock(handlers_mutex_);
    if (handlers_.source) handlers_.source(index, status);
  }

  const SiteOptions& options_;
  const SiteHandlers& handlers_;
  // Guards all below except `next_id_`. Taken inside `handlers_mutex_`, never around it.
  std::mutex mutex_;
  std::condition_variable changed_;
  FairScheduler scheduler_;
  std::vector<std::unique_ptr<Camera>> cameras_;
  std::size_t feeding_;  // number of feeding threads
  std::exception_ptr error_;
  std::stop_source stop_;
  std::mutex handlers_mutex_;  // guards the handlers
  std::int64_t next_id_ = 1;
  std::stop_callback<std::function<void()>> forward_stop_;  // last: calls end()
};

}  // namespace

void SiteOptions::check() const {
  check_fields(*this);
  motion.check();
}

std::vector<CameraReport> run_site(const std::vector<SiteCamera>& cameras,
                                   const SiteOptions& options, const SiteHandlers& handlers,
                                   const std::stop_token& stop) {
  TARSIER_REQUIRE(!cameras.empty(), "no cameras");
  options.check();
  return Site(cameras, options, handlers, stop).run();
}

}  // namespace tarsier::plate
