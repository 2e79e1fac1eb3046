// SPDX-License-Identifier: MIT
#pragma once

#include "job_lines.h"
#include "jobs.h"
#include <chrono>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

// One job in memory: shared by jobs.cpp, which stores jobs, and job_runner.cpp, which runs them.
namespace tarsier::web {

struct Jobs::Job {
  std::string id;
  VerbRequest request;
  std::string name;
  std::string shell_text;  // the command
  JobState state = JobState::kQueued;
  nlohmann::json progress;
  double created = 0, started = 0, ended = 0;
  std::optional<int> exit;
  std::string error;
  std::deque<std::string> lines;
  // While it runs:
  CommandLine command;
  std::unique_ptr<ChildProcess> child;
  std::optional<ChildEnd> end;
  bool cancelled = false;
  std::string stop_reason;  // reason, if the server stopped it
  std::string last_error;
  BoundedFile output, log;
  std::vector<std::string> forgotten_names;  // of people who were forgotten before it ended
  bool is_new = true;                        // has a change to publish
  std::chrono::steady_clock::time_point published{};
  std::chrono::steady_clock::time_point measured{};
  std::string measured_stage;
};

inline bool is_over(JobState state) {
  return state != JobState::kQueued && state != JobState::kRunning;
}

// Seconds since 1970.
inline double now_seconds() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

}  // namespace tarsier::web
