// SPDX-License-Identifier: MIT
#pragma once

#include "audit_log.h"
#include "job_feed.h"
#include "live_session.h"
#include "router.h"
#include "verb_policy.h"
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

namespace tarsier::web {

// A camera of somebody's browser, which sends its pictures one by one (POST
// /api/viewer-cameras/ID/frame). Sessions that have it as their input get the newest. Thread-safe.
class ViewerCameras {
 public:
  static constexpr std::size_t kMost = 16;
  static constexpr std::uint64_t kMaxFrame = 16 << 20;  // bytes of a JPEG
  static constexpr std::chrono::seconds kSilence{60};   // then it is forgotten

  // "ab12.." of a new one. HttpError 409 where there are too many.
  [[nodiscard]] std::string add();
  // HttpError 404; 415 where it is no JPEG or has more than 100 MP.
  void put(const std::string& id, std::string jpeg);
  void remove(const std::string& id);  // HttpError 404
  [[nodiscard]] bool has(const std::string& id) const;
  [[nodiscard]] std::vector<std::string> ids() const;
  void attach(const std::string& id, const std::shared_ptr<LiveSession>& session);
  void forget_silent();

 private:
  struct Camera {
    std::chrono::steady_clock::time_point heard;
    std::shared_ptr<const std::string> newest;
    std::vector<std::weak_ptr<LiveSession>> sessions;
  };
  static void end(Camera& camera);
  mutable std::mutex mutex_;
  std::map<std::string, Camera> cameras_;
};

struct LiveOptions {
  std::string program;  // the path of tarsier
  const VerbTable* verbs = nullptr;
  References references;
  // --allow-source: the name and what it stands for, which may hold a password.
  std::vector<std::pair<std::string, std::string>> allowed;
  std::size_t max_sessions = 9;  // that run
  std::size_t max_ended = 20;    // that are remembered
  std::size_t max_streams = 32;  // /api/live and stream.mjpg together
  std::uint64_t max_memory_bytes = 0;
  // More entries for GET /api/sources (sets of the workspace).
  std::function<nlohmann::json()> more_sources;
};

// The sessions that run, and who watches them.
class Live {
 public:
  Live(LiveOptions options, JobFeed& jobs, AuditLog& audit);
  ~Live();
  Live(const Live&) = delete;
  Live& operator=(const Live&) = delete;

  // /api/sources, /api/viewer-cameras.., /api/sessions.., /api/live
  void add_routes(Router& router);
  // Ends all sessions and streams; returns within about 0.4 s.
  void stop();

  // The word for a source's reference: synth:, camera:N, allowed:NAME, viewer:ID. Throws
  // UsageError.
  [[nodiscard]] std::string source_word(const std::string& reference) const;

  // The list of all Session objects.
  [[nodiscard]] nlohmann::json sessions() const;

  struct Counts {
    std::size_t running = 0;
    std::size_t streams = 0;
    double cpu_seconds = 0;  // of the running children
    std::uint64_t resident_bytes = 0;
  };
  [[nodiscard]] Counts counts() const;

 private:
  friend class LiveStream;
  friend class MjpegStream;
  struct StreamSlot;

  [[nodiscard]] Response list_sources() const;
  [[nodiscard]] Response start(const Request& request);
  [[nodiscard]] Response take_events(const Request& request);
  [[nodiscard]] Response send_snapshot(const Request& request);
  [[nodiscard]] Response send_live(const Request& request);
  [[nodiscard]] Response send_mjpeg(const Request& request);
  [[nodiscard]] std::shared_ptr<LiveSession> find(const std::string& id) const;         // or null
  [[nodiscard]] std::shared_ptr<LiveSession> session_of(const Request& request) const;  // or 404
  [[nodiscard]] std::shared_ptr<StreamSlot> new_slot();
  void remove_streams();
  void keep();

  LiveOptions options_;
  JobFeed& jobs_;
  AuditLog& audit_;
  ViewerCameras cameras_;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::shared_ptr<LiveSession>> sessions_;  // in the order of their start
  std::vector<std::weak_ptr<Waker>> job_viewers_;
  std::size_t streams_ = 0;
  bool is_stopping_ = false;
  std::thread keeper_;
};

}  // namespace tarsier::web
