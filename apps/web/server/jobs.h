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
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace tarsier::web {

class AuditLog;
class JobFeed;
class Router;
struct Request;

// What starts verbs, for jobs and runs alike.
struct VerbHost {
  Workspace& workspace;
  const VerbTable& verbs;
  AuditLog& audit;
  std::string program;  // path of `tarsier`
  // The word for "camera:0", "allowed:NAME"; throws UsageError. See References::source.
  std::function<std::string(const std::string& reference)> source;
  // Called with the name when a run of `people forget` was done; may be empty.
  std::function<void(const std::string& name)> forgotten = {};

  // Throws UsageError; `output_folder` as in References.
  [[nodiscard]] CommandLine command(const VerbRequest& request, Use use,
                                    const std::string& output_folder) const;
  // Tells the audit log of what is worth it. People are named by a sum of their name: the log
  // outlives those who were forgotten.
  void tell_audit(const CommandLine& line, const VerbRequest& request,
                  const std::string& address) const;
  // A child of this command; it sees no display.
  [[nodiscard]] ChildOptions child(const CommandLine& line, const std::string& folder) const;
  // A line of output as pages may see it: no addresses of sources, references instead of paths.
  [[nodiscard]] std::string public_line(std::string_view line, const CommandLine& command) const;
};

enum class JobState { kQueued, kRunning, kDone, kFailed, kCancelled, kInterrupted };
[[nodiscard]] std::string_view name_of(JobState state);  // "queued", ..

struct JobOptions {
  int parallel = 1;                            // children at a time, 1..16
  std::size_t queued = 50;                     // at most
  std::size_t kept = 500;                      // at most, of any state
  std::size_t lines = 100;                     // of stdout that are answered
  std::uint64_t line_bytes = 256ULL << 20U;    // of lines.jsonl; what is more is left out
  std::uint64_t log_bytes = 4ULL << 20U;       // of log.txt; likewise
  std::chrono::milliseconds patience{10'000};  // from SIGINT to SIGKILL
};

// Long work, one child process each, kept in the workspace:
//
//   jobs/ID/job.json     the request and what became of it, replaced whole at each change of state
//   jobs/ID/lines.jsonl  stdout   jobs/ID/log.txt  stderr without progress   jobs/ID/files/  results
//
// What start() has answered is on the disk. After the end of the server, however it came, jobs that
// ran are "interrupted" and those that waited wait again. Thread-safe. Errors are HttpError.
class Jobs {
 public:
  Jobs(const VerbHost& host, JobFeed& feed, JobOptions options = {});
  ~Jobs();  // stop()
  // Running jobs get SIGINT, 0.4 s later SIGKILL, and are "interrupted"; none begins any more.
  void stop();
  Jobs(const Jobs&) = delete;
  Jobs& operator=(const Jobs&) = delete;

  // {"verb","inputs","flags","name"?}; answers the Job. 400, 429 (too many), 507.
  nlohmann::json start(const nlohmann::json& request, const std::string& address);
  [[nodiscard]] nlohmann::json list() const;  // newest first, without lines and files
  [[nodiscard]] nlohmann::json get(const std::string& id) const;
  void cancel(const std::string& id);  // 409 where it is over
  void remove(const std::string& id);  // 409 where it is not
  // Of a job that was cut short: the same job again, in its folder, so that verbs that keep
  // checkpoints go on. Of one that is done: a new one.
  nlohmann::json again(const std::string& id, const std::string& address);
  // Takes the name of a person who was forgotten out of what jobs about people keep: their requests,
  // lines and logs. `people forget` as a job does it by itself.
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
  bool ending_ = false;
  std::map<std::string, std::shared_ptr<Job>> jobs_;  // by id: by time
  std::thread scheduler_;
};

// /api/jobs ..
void bind_jobs(Router& router, Jobs& jobs, Workspace& workspace, AuditLog& audit,
               const std::string& own_program);

// The progress that a line of stderr tells ({"progress":"mapping","done":3,"total":11,..}), as
// {"label","done","total","unit"}, with {"values": {"loss": 0.3}} where the stage measures something;
// nothing for any other line.
[[nodiscard]] std::optional<nlohmann::json> progress_of(std::string_view line);

}  // namespace tarsier::web
