// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/recorder.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/plate/tracking/crop_bytes.h"
#include "tarsier/plate/tracking/log.h"

#include <fmt/format.h>

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <exception>
#include <fstream>
#include <iterator>
#include <map>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <system_error>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

namespace tarsier::plate {
namespace {

using Clock = std::chrono::steady_clock;

Clock::duration seconds(double s) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(s));
}

// The 22nd field of /proc/PID/stat: the start time in ticks. Empty if there is no such process.
std::string start_of(const std::string& process) {
  std::ifstream file("/proc/" + process + "/stat");
  const std::string stat{std::istreambuf_iterator<char>(file), {}};
  const std::size_t name_end = stat.rfind(')');  // the second field may contain anything
  if (name_end == std::string::npos) return "";
  std::size_t at = name_end + 1;
  for (int field = 2; field < 22 && at != std::string::npos; ++field) {
    at = stat.find_first_not_of(' ', stat.find(' ', at));
  }
  if (at == std::string::npos) return "";
  return stat.substr(at, stat.find(' ', at) - at);
}

// The boot id and the PID namespace.
std::string machine_name() {
  std::string boot;
  std::ifstream("/proc/sys/kernel/random/boot_id") >> boot;
  char space[64] = {};
  const ssize_t length = ::readlink("/proc/self/ns/pid", space, sizeof space - 1);
  return boot + ' ' + std::string(space, length > 0 ? static_cast<std::size_t>(length) : 0);
}

}  // namespace

std::string process_name() {
  const std::string number = std::to_string(::getpid());
  return machine_name() + ' ' + number + ' ' + start_of("self");
}

bool is_running(const std::string& process_name) {
  const std::string machine = machine_name() + ' ';
  if (!process_name.starts_with(machine)) return false;
  const std::string rest = process_name.substr(machine.size());
  const std::size_t space = rest.find(' ');
  const std::string number = rest.substr(0, space);
  if (number.empty() || number.find_first_not_of("0123456789") != std::string::npos) return false;
  const std::string start = start_of(number);
  return !start.empty() && space != std::string::npos && rest.substr(space + 1) == start;
}

class PlateRecorder::Writer {
 public:
  // A change of the log.
  struct Task {
    enum class Kind { kEvent, kShift, kTrust } kind = Kind::kEvent;
    PlateEvent event;  // without its image
    std::optional<std::vector<std::uint8_t>> crop;
    std::chrono::milliseconds by{0};
    std::uint64_t sequence = 0;
  };

  Writer(const std::string& path, const RecorderOptions& options)
      : options_((options.check(), options)), log_(path) {
    run_ = log_.begin_run(process_name(), is_running);
    log_.set_lock_timeout(options_.attempt_ms);
    thread_ = std::jthread([this](const std::stop_token& stop) {
      try {
        work(stop);
      } catch (...) {  // for example, no memory
        const std::lock_guard lock(mutex_);
        error_ = std::current_exception();
        changed_.notify_all();
      }
    });
  }

  ~Writer() { end_thread(); }

  void add(Task task) {
    std::unique_lock lock(mutex_);
    throw_error();
    if (!replace(task)) {
      changed_.wait(lock, [&] { return error_ || count() < options_.max_waiting; });
      throw_error();
      task.sequence = ++last_sequence_;
      tasks_.push_back(std::move(task));
    }
    const std::uint64_t own_sequence = last_sequence_;
    changed_.notify_all();
    changed_.wait_for(lock, seconds(options_.max_wait),
                      [&] { return error_ || is_locked_ || written_ >= own_sequence; });
  }

  // Whether the crop of this vehicle's best frame has not been submitted yet.
  bool is_new_crop(const PlateEvent& event) {
    const auto [at, added] = crops_.try_emplace(event.id, event.best_frame);
    const bool is_new = added || at->second != event.best_frame;
    at->second = event.best_frame;
    if (event.state == PlateState::kClosed || event.state == PlateState::kWithdrawn)
      crops_.erase(at);
    return is_new;
  }

  void check() {
    const std::lock_guard lock(mutex_);
    throw_error();
  }

  void finish(double timeout_s) {
    {
      std::unique_lock lock(mutex_);
      changed_.wait_for(lock, seconds(timeout_s), [&] { return error_ || count() == 0; });
      throw_error();
      if (count() > 0) throw not_written();
    }
    end_thread();
    try {
      log_.end_run(run_);
    } catch (const DatabaseLockedError&) {
      // The next run finds that this one has ended.
    }
  }

  [[nodiscard]] const std::string& path() const { return log_.path(); }

 private:
  [[nodiscard]] std::size_t count() const { return tasks_.size() + being_written_; }

  void end_thread() {
    {
      const std::lock_guard lock(mutex_);  // not between the thread's check for a stop and its wait
      thread_.request_stop();
    }
    changed_.notify_all();
    if (thread_.joinable()) thread_.join();
  }

  void throw_error() const {
    if (error_) std::rethrow_exception(error_);
  }

  [[nodiscard]] OutputError not_written() const {
    return {log_.path(), fmt::format("is locked by another program: {} {} not written", count(),
                                     count() == 1 ? "entry was" : "entries were")};
  }

  // For one vehicle, only the latest waiting event is needed.
  bool replace(Task& task) {
    if (task.kind != Task::Kind::kEvent) return false;
    for (auto waiting = tasks_.rbegin(); waiting != tasks_.rend(); ++waiting) {
      // No event overtakes a clock correction.
      if (waiting->kind != Task::Kind::kEvent) return false;
      if (waiting->event.id != task.event.id) continue;
      if (!task.crop) task.crop = std::move(waiting->crop);
      // It moves to the end, because the vehicle it was merged into may wait before it.
      tasks_.erase(std::next(waiting).base());
      task.sequence = ++last_sequence_;
      tasks_.push_back(std::move(task));
      return true;
    }
    return false;
  }

  void work(const std::stop_token& stop) {
    std::vector<Task> batch;
    bool was_locked = false;
    Clock::time_point locked_since{};
    while (true) {
      {
        std::unique_lock lock(mutex_);
        changed_.wait(lock,
                      [&] { return !batch.empty() || !tasks_.empty() || stop.stop_requested(); });
        std::move(tasks_.begin(), tasks_.end(), std::back_inserter(batch));
        tasks_.clear();
        being_written_ = batch.size();
        if (batch.empty()) return;
      }
      try {
        write(batch);
      } catch (const DatabaseLockedError&) {
        if (!std::exchange(was_locked, true)) {
          locked_since = Clock::now();
          log_warning("{}: is locked by another program; reading continues, entries are queued",
                      log_.path());
        }
        const std::lock_guard lock(mutex_);
        is_locked_ = true;
        const bool is_over = Clock::now() - locked_since > seconds(options_.max_lock);
        if (is_over || stop.stop_requested()) error_ = std::make_exception_ptr(not_written());
        changed_.notify_all();
        if (error_) return;
        continue;
      }
      if (std::exchange(was_locked, false))
        log_info("{}: is free again, {} written", log_.path(), batch.size());
      const std::lock_guard lock(mutex_);
      is_locked_ = false;
      written_ = batch.back().sequence;
      being_written_ = 0;
      batch.clear();
      changed_.notify_all();
    }
  }

  void write(const std::vector<Task>& batch) {
    std::map<std::int64_t, std::int64_t> rows = rows_;  // of open vehicles
    Transaction together = log_.transaction();
    for (const Task& task : batch) {
      if (task.kind == Task::Kind::kShift) {
        log_.shift_unsynchronized(run_, task.by);
        continue;
      }
      if (task.kind == Task::Kind::kTrust) {
        log_.trust_clock(run_);
        continue;
      }
      const auto row = rows.find(task.event.id);
      const std::int64_t id = row == rows.end() ? 0 : row->second;
      if (task.event.state == PlateState::kWithdrawn) {
        if (id > 0) log_.remove(id);
        rows.erase(task.event.id);
        continue;
      }
      std::optional<std::span<const std::uint8_t>> crop;
      if (task.crop) crop = std::span<const std::uint8_t>(*task.crop);
      const std::int64_t written = log_.put(task.event, id, run_, crop);
      if (task.event.state == PlateState::kClosed) {
        rows.erase(task.event.id);
      } else {
        rows[task.event.id] = written;
      }
    }
    together.commit();
    rows_ = std::move(rows);
  }

  const RecorderOptions options_;
  PlateLog log_;  // used only by the thread after the constructor
  std::int64_t run_ = 0;
  std::map<std::int64_t, std::int64_t> rows_;   // vehicle -> entry; used by the thread
  std::map<std::int64_t, std::int64_t> crops_;  // vehicle -> best frame; used by the caller

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Task> tasks_;
  std::size_t being_written_ = 0;
  std::uint64_t last_sequence_ = 0;
  std::uint64_t written_ = 0;
  bool is_locked_ = false;
  std::exception_ptr error_;
  std::jthread thread_;  // last: ends before the rest
};

PlateRecorder::PlateRecorder(const std::string& path, const RecorderOptions& options)
    : writer_(std::make_unique<Writer>(path, options)) {}

PlateRecorder::~PlateRecorder() = default;

void PlateRecorder::record(const PlateEvent& event) {
  Writer::Task task;
  task.event = event;
  task.event.best_crop.release();
  if (writer_->is_new_crop(event) && event.state != PlateState::kWithdrawn &&
      !event.best_crop.empty()) {
    task.crop = crop_bytes(event, writer_->path());
  }
  writer_->add(std::move(task));
}

void PlateRecorder::shift_unsynchronized(std::chrono::milliseconds by) {
  Writer::Task task;
  task.kind = Writer::Task::Kind::kShift;
  task.by = by;
  writer_->add(std::move(task));
}

void PlateRecorder::trust_clock() {
  Writer::Task task;
  task.kind = Writer::Task::Kind::kTrust;
  writer_->add(std::move(task));
}

void PlateRecorder::check() { writer_->check(); }

void PlateRecorder::finish(double timeout_s) { writer_->finish(timeout_s); }

}  // namespace tarsier::plate
