// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame_sink.h"
#include "tarsier/media/frame_source.h"

#include "framework/batch.h"
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <stop_token>
#include <thread>
#include <utility>
#include <vector>

// Stages of run_session() that may run in their own threads: reading ahead and writing.
namespace tarsier::cli {

// A queue between two threads with at most two items.
template <typename T>
class Channel {
 public:
  // Waits for space; false if the channel was closed.
  bool push(T item) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return closed_ || items_.size() < kDepth; });
    if (closed_) return false;
    items_.push_back(std::move(item));
    changed_.notify_all();
    return true;
  }
  // nullopt if no item arrived in time, or if the channel is closed and empty.
  std::optional<T> pop(std::optional<std::chrono::milliseconds> timeout = std::nullopt) {
    std::unique_lock lock(mutex_);
    const auto ready = [&] { return closed_ || !items_.empty(); };
    if (timeout) {
      changed_.wait_for(lock, *timeout, ready);
    } else {
      changed_.wait(lock, ready);
    }
    if (items_.empty()) return std::nullopt;
    std::optional<T> item(std::move(items_.front()));
    items_.pop_front();
    changed_.notify_all();
    return item;
  }
  void close(bool drop_items = false) {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    if (drop_items) items_.clear();
    changed_.notify_all();
  }
  [[nodiscard]] bool drained() const {
    const std::lock_guard lock(mutex_);
    return closed_ && items_.empty();
  }

 private:
  static constexpr std::size_t kDepth = 2;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<T> items_;
  bool closed_ = false;
};

// Reads files ahead in its own thread.
class ReadAhead final : public FrameSource {
 public:
  ReadAhead(std::unique_ptr<FrameSource> source, const std::stop_token& stop);
  ~ReadAhead() override;
  ReadAhead(const ReadAhead&) = delete;
  ReadAhead& operator=(const ReadAhead&) = delete;

  std::optional<Frame> next(std::chrono::milliseconds timeout,
                            const std::stop_token& stop) override;
  // True only after next() has thrown the failure, if there was one.
  [[nodiscard]] bool ended() const override;
  [[nodiscard]] bool is_live() const override { return false; }
  [[nodiscard]] SourceStatus status() const override { return status_; }
  [[nodiscard]] double fps() const override { return fps_; }
  [[nodiscard]] std::int64_t count() const override { return count_; }
  [[nodiscard]] const std::vector<std::string>& skipped() const override;

 private:
  struct Item {
    Frame frame;
    SourceStatus status;
  };

  void read();

  std::unique_ptr<FrameSource> source_;
  double fps_;
  std::int64_t count_;
  SourceStatus status_;
  std::vector<std::string> none_skipped_;
  std::exception_ptr error_;  // of the thread; valid after its end
  Channel<Item> channel_;
  std::stop_source stop_;
  std::stop_callback<std::function<void()>> forward_stop_;
  std::jthread thread_;
};

// Prints JSON lines from two threads.
class LinePrinter {
 public:
  explicit LinePrinter(bool enabled) : enabled_(enabled) {}
  [[nodiscard]] bool enabled() const { return enabled_; }
  void print(const nlohmann::ordered_json& object);

 private:
  bool enabled_;
  std::mutex mutex_;
};

// An output image that is to be written.
struct WriteJob {
  cv::Mat image;
  Frame frame;  // without its image
  nlohmann::ordered_json line;
  bool live = false;
  bool silent = false;            // prints no line
  int repeats = 1;                // 0: prints only the line
  std::vector<std::string> rows;  // of the batch's table
};

// Writes images and their lines, in its own thread if that is faster.
class Writer {
 public:
  // `batch` may be null.
  Writer(FrameSink& sink, LinePrinter& lines, Batch* batch, bool threaded);
  ~Writer();
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;

  void write(WriteJob job);
  // Waits until everything is written. Throws the error, if one occurred.
  void complete();
  // Drops the jobs that have not been started.
  void cancel();
  [[nodiscard]] std::int64_t written() const { return written_; }  // after complete() or cancel()

 private:
  void join();
  void drain();
  void write_now(WriteJob& job);

  FrameSink& sink_;
  LinePrinter& lines_;
  Batch* batch_;
  Channel<WriteJob> channel_;
  std::exception_ptr error_;
  std::int64_t written_ = 0;
  std::jthread thread_;
};

}  // namespace tarsier::cli
