// SPDX-License-Identifier: MIT
#pragma once

#include "child_process.h"
#include "verb_policy.h"
#include "workspace.h"
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

namespace tarsier::web {

class AuditLog;
class JobFeed;
class Router;
struct Request;

// Start of the line with which a verb reports why it failed.
inline constexpr std::string_view kErrorMark = "tarsier: error: ";

// Starts verbs, for jobs and runs.
struct VerbHost {
  Workspace& workspace;
  const VerbTable& verbs;
  AuditLog& audit;
  std::string program;  // path of `tarsier`
  // Converts "camera:0", "allowed:NAME" to a source; throws UsageError. See References::source.
  std::function<std::string(const std::string& reference)> source;
  // Called with the name after a run of `people forget`; may be empty.
  std::function<void(const std::string& name)> forgotten = {};

  // Throws UsageError; `output_folder` as in References.
  [[nodiscard]] CommandLine command(const VerbRequest& request, Use use,
                                    const std::string& output_folder) const;
  // Writes relevant events to the audit log. It contains a hash instead of a person's name, because
  // the log outlives people who were forgotten.
  void write_audit(const CommandLine& line, const VerbRequest& request,
                   const std::string& address) const;
  // Options of a child process for this command; the child sees no display.
  [[nodiscard]] ChildOptions child(const CommandLine& line, const std::string& folder) const;
  // A line of output as pages may see it: without addresses of sources, with references instead of
  // paths.
  [[nodiscard]] std::string public_line(std::string_view line, const CommandLine& command) const;
};

enum class JobState { kQueued, kRunning, kDone, kFailed, kCancelled, kInterrupted };
[[nodiscard]] std::string_view name_of(JobState state);  // "queued", ..

struct JobOptions {
  int parallel = 1;  // children at the same time, 1..16
  std::size_t max_queued = 50;
  std::size_t max_jobs = 500;                    // in any state
  std::size_t lines = 100;                       // of stdout in API responses
  std::uint64_t line_bytes = 256ULL << 20U;      // limit of lines.jsonl; further lines are dropped
  std::uint64_t log_bytes = 4ULL << 20U;         // limit of log.txt; further lines are dropped
  std::chrono::milliseconds kill_delay{10'000};  // from SIGINT to SIGKILL
};

// Long work, one child process per job, stored in the workspace:
//
//   jobs/ID/job.json     the request and its result, rewritten at each change of state
//   jobs/ID/lines.jsonl  stdout   jobs/ID/log.txt  stderr without progress   jobs/ID/files/  results
//
// When start() has returned, the job is on the disk. After the server has stopped for any reason,
// running jobs are "interrupted" and queued jobs are queued again. Thread-safe. Errors are
// HttpError.
class Jobs {
 public:
  Jobs(const VerbHost& host, JobFeed& feed, JobOptions options = {});
  ~Jobs();  // calls stop()
  // Sends SIGINT to running jobs, and SIGKILL after 0.4 s; they become "interrupted". Starts no
  // more jobs.
  void stop();
  Jobs(const Jobs&) = delete;
  Jobs& operator=(const Jobs&) = delete;

  // Request: {"verb","inputs","flags","name"?}. Returns the Job. Errors 400, 429 (too many), 507.
  nlohmann::json start(const nlohmann::json& request, const std::string& address);
  [[nodiscard]] nlohmann::json list() const;  // newest first, without lines and files
  [[nodiscard]] nlohmann::json get(const std::string& id) const;
  void cancel(const std::string& id);  // 409 if it has ended
  void remove(const std::string& id);  // 409 if it has not ended
  // A job that was interrupted runs again in its folder, so that verbs with checkpoints continue.
  // For a job that is done a new job is made. 409 if a person in its request was forgotten.
  nlohmann::json restart(const std::string& id, const std::string& address);
  // Removes the name of a forgotten person from the stored requests, lines, logs and text results
  // of jobs about people; of a job that has not ended, at its end. A job of `people forget` does
  // this by itself.
  void forget_name(const std::string& name);
  [[nodiscard]] std::map<std::string, int> count_by_state() const;

 private:
  struct Job;
  using Lock = std::unique_lock<std::mutex>;

  void load();
  void schedule();
  void begin(const std::shared_ptr<Job>& job, Lock& lock);
  void finish(const std::shared_ptr<Job>& job, Lock& lock);
  void forget_name_now(const std::string& name);
  void remove_name_from(Job& job, const std::string& name);
  void take_output(Job& job, std::string_view line);
  void take_message(Job& job, std::string_view line);
  void keep_line(Job& job, std::string line) const;
  [[nodiscard]] static nlohmann::json stored(const Job& job);
  void save(const Job& job) const;
  [[nodiscard]] nlohmann::json json_of(const Job& job, bool whole) const;
  [[nodiscard]] std::shared_ptr<Job> find(const std::string& id) const;  // HttpError 404
  void publish(Job& job);
  void check_space();

  const VerbHost host_;
  JobFeed& feed_;
  const JobOptions options_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  bool is_stopping_ = false;
  std::map<std::string, std::shared_ptr<Job>> jobs_;  // sorted by id, which is also by time
  std::thread scheduler_;
};

// Adds /api/jobs ..
void bind_jobs(Router& router, Jobs& jobs, Workspace& workspace, AuditLog& audit,
               const std::string& own_program);

// Parses a progress line of stderr ({"progress":"mapping","done":3,"total":11,..}) into
// {"label","done","total","unit"}, with {"values": {"loss": 0.3}} if the stage reports measures;
// nullopt for any other line.
[[nodiscard]] std::optional<nlohmann::json> progress_of(std::string_view line);

}  // namespace tarsier::web
