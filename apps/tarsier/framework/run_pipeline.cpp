// SPDX-License-Identifier: MIT
#include "framework/run_pipeline.h"

#include "framework/cli.h"
#include <nlohmann/json.hpp>

namespace tarsier::cli {

using std::chrono::milliseconds;

ReadAhead::ReadAhead(std::unique_ptr<FrameSource> source, const std::stop_token& stop)
    : source_(std::move(source)),
      fps_(source_->fps()),
      count_(source_->count()),
      forward_stop_(stop, [this] { stop_.request_stop(); }),
      thread_([this] { read(); }) {}

ReadAhead::~ReadAhead() {
  stop_.request_stop();
  channel_.close(true);
}

std::optional<Frame> ReadAhead::next(milliseconds timeout, const std::stop_token& stop) {
  if (stop.stop_requested()) return std::nullopt;
  if (std::optional<Item> item = channel_.pop(timeout)) {
    status_ = std::move(item->status);
    return std::move(item->frame);
  }
  if (channel_.drained()) {
    if (thread_.joinable()) thread_.join();
    if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
    if (!stop.stop_requested()) status_.state = SourceState::kEnded;
  }
  return std::nullopt;
}

bool ReadAhead::ended() const { return channel_.drained() && !thread_.joinable() && !error_; }

const std::vector<std::string>& ReadAhead::skipped() const {
  return thread_.joinable() ? none_skipped_ : source_->skipped();
}

void ReadAhead::read() {
  try {
    while (!stop_.stop_requested() && !source_->ended()) {
      std::optional<Frame> frame = source_->next(milliseconds(200), stop_.get_token());
      if (frame && !channel_.push({std::move(*frame), source_->status()})) break;
    }
  } catch (...) {
    error_ = std::current_exception();
  }
  channel_.close();
}

void LinePrinter::print(const nlohmann::ordered_json& object) {
  if (!enabled_) return;
  const std::string line = json_text(object) + '\n';
  const std::lock_guard lock(mutex_);
  print_text(line);
}

Writer::Writer(FrameSink& sink, LinePrinter& lines, Batch* batch, bool threaded)
    : sink_(sink), lines_(lines), batch_(batch) {
  if (threaded) thread_ = std::jthread([this] { drain(); });
}

Writer::~Writer() { cancel(); }

void Writer::write(WriteJob job) {
  if (!thread_.joinable()) {
    write_now(job);
  } else if (!channel_.push(std::move(job))) {
    complete();  // throws the error that ended the thread
  }
}

void Writer::complete() {
  channel_.close();
  join();
  if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
}

void Writer::cancel() {
  channel_.close(true);
  join();
}

void Writer::join() {
  if (thread_.joinable()) thread_.join();
}

void Writer::drain() {
  try {
    while (std::optional<WriteJob> job = channel_.pop()) write_now(*job);
  } catch (...) {
    error_ = std::current_exception();
    channel_.close(true);
  }
}

void Writer::write_now(WriteJob& job) {
  for (int i = 0; i < job.repeats; ++i) {
    const std::string path = sink_.write(job.image, job.frame);
    if (!path.empty()) job.line["output"] = path;
    ++written_;
  }
  if (job.live) {
    const auto age = std::chrono::steady_clock::now() - job.frame.captured;
    job.line["age_ms"] = rounded(std::chrono::duration<double, std::milli>(age).count(), 1);
  }
  if (!job.silent) lines_.print(job.line);
  if (batch_ != nullptr) batch_->record(job.frame.index, job.line, job.rows);
}

}  // namespace tarsier::cli
