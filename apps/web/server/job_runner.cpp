// SPDX-License-Identifier: MIT
// How Jobs runs jobs: the thread of schedule(), and the children's output.
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"

#include "framework/exit_status.h"
#include "job.h"
#include "job_feed.h"
#include "router.h"
#include <algorithm>
#include <utility>

namespace tarsier::web {
namespace {

using Clock = std::chrono::steady_clock;

constexpr auto kPublishEvery = std::chrono::milliseconds(400);
constexpr auto kSpaceEvery = std::chrono::seconds(2);
constexpr auto kCurveEvery = std::chrono::milliseconds(500);
constexpr std::size_t kLongLine = 256U << 10U;

}  // namespace

void Jobs::take_output(Job& job, std::string_view line) {
  const std::string text = host_.public_line(line, job.command);
  const Lock lock(mutex_);
  job.output.add(text);
  keep_line(job, text);
}

void Jobs::keep_line(Job& job, std::string line) const {
  if (line.size() > kLongLine) line = shortened(line);
  job.lines.push_back(std::move(line));
  if (job.lines.size() > options_.lines) job.lines.pop_front();
  job.is_new = true;
}

void Jobs::take_message(Job& job, std::string_view line) {
  if (auto progress = progress_of(line)) {
    const Lock lock(mutex_);
    job.progress = std::move(*progress);
    job.is_new = true;
    // Measures are drawn as a curve, so these lines are kept: for each stage the first, the last,
    // and some between.
    const auto stage = job.progress["label"].get<std::string>();
    const bool is_due = stage != job.measured_stage ||
                        job.progress["done"] == job.progress["total"] ||
                        Clock::now() - job.measured >= kCurveEvery;
    if (job.progress.contains("values") && is_due) {
      job.measured = Clock::now();
      job.measured_stage = stage;
      job.output.add(line);
      keep_line(job, std::string(line));
    }
    return;
  }
  const std::string text = host_.public_line(line, job.command);
  const Lock lock(mutex_);
  job.log.add(text);
  if (text.starts_with(kErrorMark)) job.last_error = text.substr(kErrorMark.size());
}

void Jobs::begin(const std::shared_ptr<Job>& job, Lock& lock) {
  const std::string folder = host_.workspace.job_folder(job->id);
  job->state = JobState::kRunning;
  job->started = now_seconds();
  job->end.reset();
  job->last_error.clear();
  job->stop_reason.clear();
  job->is_new = true;
  const auto fail = [&](const std::string& why) {
    job->state = JobState::kFailed;
    job->error = why;
    job->ended = now_seconds();
    save(*job);
  };
  try {
    host_.workspace.check_space(0);
    job->command = host_.command(job->request, Use::kJob, folder + "/files");
    save(*job);
    job->output.open(folder + "/lines.jsonl", options_.line_bytes, true);
    job->log.open(folder + "/log.txt", options_.log_bytes, true);
    ChildOptions options = host_.child(job->command, folder + "/files");
    options.niceness = 10;  // live sessions have priority
    options.max_line = 16U << 20U;
    Job* const raw = job.get();
    options.on_output = [this, raw](std::string_view line) { take_output(*raw, line); };
    options.on_message = [this, raw](std::string_view line) { take_message(*raw, line); };
    lock.unlock();
    std::unique_ptr<ChildProcess> child;
    std::string problem;
    try {
      child = std::make_unique<ChildProcess>(std::move(options), [this, raw](const ChildEnd& end) {
        const Lock inner(mutex_);
        raw->end = end;
        changed_.notify_all();
      });
    } catch (const std::exception& error) {
      problem = error.what();
    }
    lock.lock();
    if (!child) return fail(problem);
    job->child = std::move(child);
    if (job->cancelled || is_stopping_) job->child->interrupt(options_.kill_delay);
  } catch (const std::exception& error) {  // a set that was deleted meanwhile, a full disk
    if (!lock.owns_lock()) lock.lock();
    fail(error.what());
  }
}

void Jobs::finish(const std::shared_ptr<Job>& job, Lock& lock) {
  std::unique_ptr<ChildProcess> child = std::move(job->child);
  lock.unlock();
  child.reset();
  lock.lock();
  const ChildEnd end = *job->end;
  job->output.close();
  job->log.close();
  job->exit = end.exit;
  job->ended = now_seconds();
  const bool is_done = end.exit == static_cast<int>(ExitStatus::kDone) ||
                       end.exit == static_cast<int>(ExitStatus::kNothingFound);
  if (!job->stop_reason.empty()) {
    job->state = JobState::kFailed;
    job->error = job->stop_reason;
  } else if (is_stopping_ && !job->cancelled && !is_done) {
    job->state = JobState::kInterrupted;
    job->error = "the studio was stopped during the job; start the job again";
  } else if (job->cancelled && !is_done) {
    job->state = JobState::kCancelled;
    job->error.clear();
  } else if (is_done) {
    job->state = JobState::kDone;
    job->error = job->exit == 0 ? "" : job->last_error;
  } else {
    job->state = JobState::kFailed;
    job->error = job->last_error.empty() ? "the program " + end.text() : job->last_error;
  }
  job->is_new = true;
  save(*job);
  if (is_done && job->request.verb == "people forget" && !job->request.inputs.empty()) {
    forget_name_now(std::string(job->request.inputs.front()));
  }
}

void Jobs::publish(Job& job) {
  job.is_new = false;
  job.published = Clock::now();
  feed_.publish(job.id, to_text(json_of(job, true)));
}

void Jobs::check_space() {
  std::string problem;
  try {
    host_.workspace.check_space(0);
  } catch (const HttpError& error) {
    problem = error.what();
  }
  if (problem.empty()) return;
  for (const auto& [id, job] : jobs_) {
    if (job->state != JobState::kRunning || !job->child || !job->stop_reason.empty()) continue;
    job->stop_reason = problem;
    job->child->interrupt(options_.kill_delay);
  }
}

void Jobs::schedule() {
  Clock::time_point space{};
  Lock lock(mutex_);
  while (true) {
    try {
      int running = 0;
      std::shared_ptr<Job> next;
      for (const auto& [id, job] : std::map(jobs_)) {
        if (job->state == JobState::kRunning && job->end) finish(job, lock);
        if (is_over(job->state)) {
          for (const std::string& name : std::exchange(job->forgotten_names, {}))
            remove_name_from(*job, name);
        }
        if (job->state == JobState::kRunning) ++running;
        if (job->state == JobState::kQueued && !next) next = job;
      }
      const bool starts = next && running < options_.parallel && !is_stopping_;
      if (starts) begin(next, lock);
      const auto now = Clock::now();
      for (const auto& [id, job] : jobs_) {
        if (job->is_new && (is_over(job->state) || now - job->published >= kPublishEvery))
          publish(*job);
      }
      if (running > 0 && now - space > kSpaceEvery) {
        space = now;
        check_space();
      }
      if (is_stopping_ && running == 0) return;
      if (starts) continue;
    } catch (const std::exception& error) {  // a full disk: the state in memory is kept
      log_warning("jobs: {}", error.what());
      if (!lock.owns_lock()) lock.lock();
      if (is_stopping_) return;
    }
    const bool busy = std::any_of(jobs_.begin(), jobs_.end(), [](const auto& entry) {
      return !is_over(entry.second->state) || entry.second->is_new;
    });
    if (busy) {
      changed_.wait_for(lock, kPublishEvery);
    } else {
      changed_.wait(lock);
    }
  }
}

}  // namespace tarsier::web
