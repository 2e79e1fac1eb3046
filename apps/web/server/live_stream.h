// SPDX-License-Identifier: MIT
#pragma once

#include "job_feed.h"
#include "live_session.h"
#include "router.h"
#include <chrono>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::web {

// Counts the live streams of each viewer. Thread-safe.
//
// A browser opens at most six connections to a server for all its tabs, and a stream occupies one.
// Six streams in six windows would leave no connection for other requests. So the streams of a
// browser with more than kMaxConcurrent take turns: each ends after kTurn, and the page requests it
// again.
class StreamSlots {
 public:
  static constexpr std::size_t kMaxConcurrent = 4;
  static constexpr std::chrono::milliseconds kTurn{2000};

  explicit StreamSlots(std::size_t max_streams) : max_streams_(max_streams) {}

  // Counts a stream while it lives. Must not outlive its StreamSlots.
  class Slot {
   public:
    Slot(StreamSlots& owner, std::string viewer) : owner_(owner), viewer_(std::move(viewer)) {}
    ~Slot();
    Slot(const Slot&) = delete;
    Slot& operator=(const Slot&) = delete;
    // Whether the viewer's streams must take turns.
    [[nodiscard]] bool takes_turns() const;

   private:
    StreamSlots& owner_;
    const std::string viewer_;
  };

  // `viewer` is the sign-in of a browser, or "" for a program, whose streams take no turns.
  // HttpError 503 if there are too many.
  [[nodiscard]] std::shared_ptr<Slot> take(const std::string& viewer);

 private:
  const std::size_t max_streams_;
  mutable std::mutex mutex_;
  std::size_t count_ = 0;
  std::map<std::string, std::size_t> of_viewer_;
};

// GET /api/live: hello, states and images of `sessions` (each with the width at which the viewer
// shows it, px; 0: full size), the end of each, "there is no such session" for `unknown`, and the
// news of `jobs` (null: none). All of them wake `waker`. A viewer that reads its images slowly gets
// a lower JPEG quality (JpegQualityControl), unless another viewer can read more. `now` is the
// clock.
using ClockTime = std::chrono::steady_clock::time_point;
[[nodiscard]] std::unique_ptr<BodyStream> make_live_stream(
    std::shared_ptr<StreamSlots::Slot> slot, std::shared_ptr<Waker> waker,
    std::vector<std::string> unknown,
    const std::vector<std::pair<std::shared_ptr<LiveSession>, int>>& sessions, const JobFeed* jobs,
    std::function<ClockTime()> now = std::chrono::steady_clock::now);

// GET /api/sessions/ID/stream.mjpg
[[nodiscard]] std::unique_ptr<BodyStream> make_mjpeg_stream(std::shared_ptr<StreamSlots::Slot> slot,
                                                            std::shared_ptr<LiveSession> session);

}  // namespace tarsier::web
