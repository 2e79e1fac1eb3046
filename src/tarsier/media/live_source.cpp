// SPDX-License-Identifier: MIT
#include "tarsier/media/live_source.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/image_file.h"

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <thread>
#include <utility>

namespace tarsier {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

double seconds_between(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

Clock::time_point after(Clock::time_point start, double seconds) {
  return start +
         std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

std::string in_seconds(double seconds) {
  return seconds < 10 && seconds != static_cast<double>(static_cast<int>(seconds))
             ? fmt::format("{:.1f} s", seconds)
             : fmt::format("{:.0f} s", seconds);
}

class LiveSource final : public FrameSource {
 public:
  LiveSource(std::string name, std::string label, LiveBackendFactory make_backend,
             const SourceOptions& options, const LiveTiming& timing)
      : name_(std::move(name)),
        label_(std::move(label)),
        make_backend_(std::move(make_backend)),
        options_(options),
        timing_(timing),
        backoff_s_(timing.backoff_s),
        fps_(options.fps),
        detail_("connecting"),
        supervisor_([this](const std::stop_token& stop) { supervise(stop); }) {}

  std::optional<Frame> next(milliseconds timeout, const std::stop_token& stop) override;

  [[nodiscard]] bool ended() const override {
    const std::lock_guard lock(mutex_);
    return gave_up_;
  }
  [[nodiscard]] bool is_live() const override { return true; }
  [[nodiscard]] SourceStatus status() const override;
  [[nodiscard]] double fps() const override {
    const std::lock_guard lock(mutex_);
    return fps_;
  }
  [[nodiscard]] std::int64_t count() const override { return 0; }
  [[nodiscard]] const std::vector<std::string>& skipped() const override { return skipped_; }

 private:
  // All other functions except next() and the accessors run in the supervising thread.
  void supervise(const std::stop_token& stop);
  LiveFailure follow(const std::stop_token& stop);
  bool wait_to_reopen(const LiveFailure& failure, const std::stop_token& stop);
  bool silent_connection_recovered(milliseconds timeout, const std::stop_token& stop);
  void deliver(LiveRead&& read);
  void enter(SourceState state, std::string detail);
  bool has_timed_out(const std::string& reason);
  void give_up(const std::string& reason);
  [[nodiscard]] bool had_frame() const;                    // mutex_ held
  [[nodiscard]] Clock::time_point last_decodable() const;  // mutex_ held; only when had_frame()

  const std::string name_;
  const std::string label_;
  const LiveBackendFactory make_backend_;
  const SourceOptions options_;
  const LiveTiming timing_;
  const std::vector<std::string> skipped_;
  const Clock::time_point started_ = Clock::now();

  // Used only by the supervising thread.
  std::unique_ptr<LiveBackend> current_;
  std::unique_ptr<LiveBackend> silent_;  // an older connection that is open but silent
  double backoff_s_;
  int openings_ = 0;
  std::string last_reason_;

  mutable std::mutex mutex_;
  std::condition_variable_any wake_;  // the slot was filled, or gave_up_
  std::optional<LiveImage> slot_;
  std::int64_t slot_index_ = 0;
  Clock::time_point first_;
  Clock::time_point newest_;
  Clock::time_point last_decoded_;
  bool decoded_any_ = false;
  bool decode_fails_ =
      false;  // the last JPEG taken was broken: until one is not, arrivals do not count as frames
  double fps_;
  SourceState state_ = SourceState::kConnecting;
  std::string detail_;
  std::int64_t received_ = 0;
  std::int64_t dropped_ = 0;
  int reopened_ = 0;
  bool gave_up_ = false;
  bool gave_up_before_first_ = false;
  std::string gave_up_reason_;
  bool opens_once_ = false;
  std::optional<Clock::time_point> warned_;

  std::jthread supervisor_;  // last: stops before the members that it uses are destroyed
};

std::optional<Frame> LiveSource::next(milliseconds timeout, const std::stop_token& stop) {
  const Clock::time_point deadline = Clock::now() + timeout;
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait_until(lock, stop, deadline, [this] { return slot_.has_value() || gave_up_; });
    if (stop.stop_requested()) return std::nullopt;
    if (!slot_) {
      if (!gave_up_) return std::nullopt;
      if (gave_up_before_first_) throw InputError(label_, gave_up_reason_);
      throw SourceLostError(label_, gave_up_reason_);
    }
    LiveImage image = std::move(*slot_);
    slot_.reset();
    Frame frame;
    frame.index = slot_index_;
    frame.time = seconds_between(first_, image.arrived);
    frame.name = name_;
    frame.captured = image.arrived;
    if (image.encoded.empty()) {
      frame.image = std::move(image.image);
      return frame;
    }
    lock.unlock();
    std::string error_message;
    try {
      frame.image = decode_image(image.encoded, label_);
    } catch (const InputError& error) {
      error_message = error.what();
    }
    lock.lock();
    decode_fails_ = frame.image.empty();
    if (!decode_fails_) {
      decoded_any_ = true;
      last_decoded_ = image.arrived;
      return frame;
    }
    // Occasional corrupt images of a camera do not concern the user, but those of another program
    // do.
    const Clock::time_point now = Clock::now();
    if (opens_once_ && (!warned_ || now - *warned_ >= kWarningInterval)) {
      warned_ = now;
      log_warning("{}; it is skipped", error_message);
    } else {
      log_debug("{}", error_message);
    }
  }
}

SourceStatus LiveSource::status() const {
  const std::lock_guard lock(mutex_);
  SourceStatus status;
  status.state = state_;
  status.detail = detail_;
  const Clock::time_point newest = had_frame() ? last_decodable() : newest_;
  status.age_s = received_ > 0 ? std::max(0.0, seconds_between(newest, Clock::now())) : 0;
  status.received = received_;
  status.dropped = dropped_;
  status.reopened = reopened_;
  return status;
}

bool LiveSource::had_frame() const { return decoded_any_ || (received_ > 0 && !decode_fails_); }

Clock::time_point LiveSource::last_decodable() const {
  return decode_fails_ ? last_decoded_ : newest_;
}

void LiveSource::enter(SourceState state, std::string detail) {
  const std::lock_guard lock(mutex_);
  state_ = state;
  detail_ = std::move(detail);
}

void LiveSource::deliver(LiveRead&& read) {
  {
    const std::lock_guard lock(mutex_);
    if (received_ == 0) first_ = read.image.arrived;
    received_ += read.frames;
    dropped_ += read.frames - 1 + (slot_ ? 1 : 0);
    newest_ = read.image.arrived;
    slot_index_ = received_ - 1;
    slot_ = std::move(read.image);
    if (current_->fps() > 0) fps_ = current_->fps();
  }
  wake_.notify_all();
}

void LiveSource::give_up(const std::string& reason) {
  {
    const std::lock_guard lock(mutex_);
    gave_up_ = true;
    gave_up_before_first_ = !had_frame();
    gave_up_reason_ = reason;
    state_ = SourceState::kLost;
    detail_ = reason;
  }
  wake_.notify_all();
}

// Whether the user's time limit has passed; then the consumer gets a status.
bool LiveSource::has_timed_out(const std::string& reason) {
  std::string message;
  {
    const std::lock_guard lock(mutex_);
    const Clock::time_point now = Clock::now();
    if (!had_frame()) {
      if (options_.wait || seconds_between(started_, now) < options_.connect_timeout_s)
        return false;
      message = fmt::format("no image within {}{}{}", in_seconds(options_.connect_timeout_s),
                            reason.empty() ? "" : ": ", reason);
    } else {
      if (options_.give_up_s <= 0 || seconds_between(last_decodable(), now) < options_.give_up_s) {
        return false;
      }
      message = fmt::format("no image for {}{}{}", in_seconds(options_.give_up_s),
                            reason.empty() ? "" : ": ", reason);
    }
  }
  give_up(message);
  return true;
}

// Reads the older connection. If it sends again it becomes the current one, and true is returned.
bool LiveSource::silent_connection_recovered(milliseconds timeout, const std::stop_token& stop) {
  LiveRead read = silent_->read(timeout, stop);
  if (read.kind == LiveRead::Kind::kEnded) {
    silent_.reset();
  } else if (read.kind == LiveRead::Kind::kFrame) {
    current_ = std::move(silent_);
    deliver(std::move(read));
    return true;
  }
  return false;
}

// Reads the current connection until it ends, is given up or the thread is stopped; returns the
// reason.
LiveFailure LiveSource::follow(const std::stop_token& stop) {
  const Clock::time_point opened = Clock::now();
  Clock::time_point live_since = opened;
  SourceState state = SourceState::kConnecting;
  bool has_frame = false;
  while (!stop.stop_requested()) {
    LiveRead read = current_->read(kStopCheckInterval, stop);
    if (read.kind == LiveRead::Kind::kEnded) return read.failure;
    if (read.kind == LiveRead::Kind::kFrame) {
      deliver(std::move(read));
      has_frame = true;
    }
    if (!has_frame && silent_ && silent_connection_recovered(milliseconds(0), stop))
      has_frame = true;

    const Clock::time_point now = Clock::now();
    double quiet_s = seconds_between(opened, now);
    bool is_good = false;  // frames of this connection arrive and can be decoded
    {
      const std::lock_guard lock(mutex_);
      if (has_frame && had_frame()) {
        const double since_last_s = seconds_between(last_decodable(), now);
        quiet_s = std::min(quiet_s, since_last_s);
        is_good = since_last_s < options_.stall_s;
      }
    }
    if (is_good && state != SourceState::kLive) {
      const bool is_first = openings_ == 1 && state == SourceState::kConnecting;
      silent_.reset();
      live_since = now;
      state = SourceState::kLive;
      last_reason_.clear();
      enter(state, current_->detail());
      log_info("{}: {} ({})", label_, is_first ? "live" : "live again", current_->detail());
    } else if (is_good && seconds_between(live_since, now) >= timing_.healthy_s) {
      backoff_s_ = timing_.backoff_s;
    }
    const double allowed_s =
        has_frame ? options_.stall_s : std::max(options_.stall_s, current_->startup_s());
    if (quiet_s >= allowed_s && state != SourceState::kStale) {
      state = SourceState::kStale;
      last_reason_ = fmt::format("no image for {}", in_seconds(allowed_s));
      enter(state, last_reason_);
      if (current_->may_recover()) log_warning("{}: {}; still listening", label_, last_reason_);
    }
    const double drop_s =
        allowed_s + (current_->may_recover() ? std::max(options_.stall_s, backoff_s_) : 0);
    if (quiet_s >= drop_s && !current_->opens_once()) {
      LiveFailure failure;
      failure.reason = fmt::format("no image for {}", in_seconds(quiet_s));
      // A frozen server that accepts only one client would never accept us again after a
      // disconnect. So the old connection stays open until the new one delivers a frame.
      if (current_->may_recover() && !silent_) silent_ = std::move(current_);
      current_.reset();
      return failure;
    }
    if (has_timed_out(last_reason_)) break;
  }
  return {};
}

// Waits for the back-off. Returns true if the older connection recovered meanwhile and is current
// again.
bool LiveSource::wait_to_reopen(const LiveFailure& failure, const std::stop_token& stop) {
  double wait_s = backoff_s_;
  if (!failure.unreachable && !failure.denied)
    wait_s = std::min(wait_s, timing_.max_wait_when_answering_s);
  backoff_s_ = std::min(2 * backoff_s_, timing_.backoff_max_s);
  log_warning("{}: {}; retry in {}{}", label_, failure.reason, in_seconds(wait_s),
              failure.unreachable && wait_s > timing_.probe_s ? ", or as soon as it answers" : "");
  const Clock::time_point begun = Clock::now();
  const Clock::time_point end = after(begun, wait_s);
  Clock::time_point next_probe = after(begun, timing_.probe_s);
  while (!stop.stop_requested() && Clock::now() < end) {
    if (silent_) {
      if (silent_connection_recovered(kStopCheckInterval, stop)) return true;
    } else {
      sleep_unless_stopped(kStopCheckInterval, stop);
    }
    if (has_timed_out(failure.reason)) return false;
    if (failure.unreachable && Clock::now() >= next_probe) {
      if (current_->reachable(milliseconds(500), stop)) return false;
      next_probe = after(Clock::now(), timing_.probe_s);
    }
  }
  return false;
}

void LiveSource::supervise(const std::stop_token& stop) {
  try {
    current_ = make_backend_();
    {
      const std::lock_guard lock(mutex_);
      opens_once_ = current_->opens_once();
    }
    bool is_open = false;
    while (!stop.stop_requested()) {
      LiveFailure failure;
      if (!is_open) {
        enter(SourceState::kConnecting, last_reason_.empty() ? "connecting" : last_reason_);
        const double open_s = std::min(timing_.open_attempt_s, options_.connect_timeout_s);
        const auto timeout = milliseconds(static_cast<int>(1000 * open_s) + 1);
        if (auto refused = current_->open(timeout, stop)) {
          failure = std::move(*refused);
        } else {
          is_open = true;
          if (openings_++ > 0) {
            const std::lock_guard lock(mutex_);
            ++reopened_;
          }
        }
      }
      if (is_open) failure = follow(stop);
      is_open = false;
      if (stop.stop_requested()) break;
      if (current_ && current_->opens_once() && !ended()) {
        give_up(failure.reason);
        break;
      }
      bool had_any_frame = false;
      {
        const std::lock_guard lock(mutex_);
        if (gave_up_) break;
        had_any_frame = had_frame();
      }
      if (!had_any_frame && failure.permanent && !options_.wait) {
        give_up(failure.reason);
        break;
      }
      if (has_timed_out(failure.reason)) break;
      last_reason_ = failure.reason;
      current_ = make_backend_();
      enter(had_any_frame ? SourceState::kLost : SourceState::kConnecting, failure.reason);
      is_open = wait_to_reopen(failure, stop);
      if (ended()) break;
    }
  } catch (const std::exception& error) {  // out of memory, out of file descriptors
    give_up(error.what());
  }
  current_.reset();
  silent_.reset();
}

}  // namespace

std::unique_ptr<FrameSource> make_live_source(std::string name, std::string label,
                                              LiveBackendFactory make_backend,
                                              const SourceOptions& options,
                                              const LiveTiming& timing) {
  options.check();
  return std::make_unique<LiveSource>(std::move(name), std::move(label), std::move(make_backend),
                                      options, timing);
}

}  // namespace tarsier
