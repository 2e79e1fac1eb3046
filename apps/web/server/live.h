// SPDX-License-Identifier: MIT
#pragma once

#include "audit_log.h"
#include "job_feed.h"
#include "live_session.h"
#include "live_stream.h"
#include "router.h"
#include "verb_policy.h"
#include "viewer_cameras.h"
#include <chrono>
#include <condition_variable>
#include <cstdint>
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

struct LiveOptions {
  std::string program;  // the path of tarsier
  const VerbTable* verbs = nullptr;
  References references;
  std::vector<std::pair<std::string, std::string>> environment;  // variables for the children
  std::string sessions_folder;  // each child has its working directory here
  // --allow-source: the name and its source, which may contain a password.
  std::vector<std::pair<std::string, std::string>> allowed;
  // Called with the name of a person whom a session deleted.
  std::function<void(const std::string& name)> forgotten;
  std::size_t max_sessions = 9;  // running at the same time
  std::size_t max_ended = 20;    // ended sessions that are kept
  std::size_t max_streams = 32;  // /api/live and stream.mjpg together
  std::uint64_t max_memory_bytes = 0;
  // More entries for GET /api/sources (sets of the workspace).
  std::function<nlohmann::json()> more_sources;
};

// The running sessions and their viewers.
class Live {
 public:
  Live(LiveOptions options, JobFeed& jobs, AuditLog& audit);
  ~Live();
  Live(const Live&) = delete;
  Live& operator=(const Live&) = delete;

  // Adds /api/sources, /api/viewer-cameras.., /api/sessions.., /api/live.
  void add_routes(Router& router);
  // Ends all sessions and streams; returns within about 0.4 s.
  void stop();

  // Converts a reference to a source: synth:, camera:N, allowed:NAME, viewer:ID. Throws UsageError.
  [[nodiscard]] std::string resolve_source(const std::string& reference) const;

  [[nodiscard]] std::shared_ptr<LiveSession> find(const std::string& id) const;  // or null

  // The list of all Session objects.
  [[nodiscard]] nlohmann::json sessions() const;

 private:
  [[nodiscard]] Response list_sources() const;
  [[nodiscard]] Response start(const Request& request);
  [[nodiscard]] Response take_events(const Request& request);
  [[nodiscard]] Response send_snapshot(const Request& request);
  [[nodiscard]] Response send_live(const Request& request);
  [[nodiscard]] Response send_mjpeg(const Request& request);
  [[nodiscard]] std::shared_ptr<LiveSession> session_of(const Request& request) const;  // or 404
  [[nodiscard]] std::shared_ptr<StreamSlots::Slot> new_slot(const Request& request);
  void run_watchdog();

  LiveOptions options_;
  JobFeed& jobs_;
  AuditLog& audit_;
  ViewerCameras cameras_;
  StreamSlots streams_{options_.max_streams};

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::shared_ptr<LiveSession>> sessions_;  // in the order of their start
  std::vector<std::weak_ptr<Waker>> job_viewers_;
  bool is_stopping_ = false;
  std::thread watchdog_;
};

}  // namespace tarsier::web
