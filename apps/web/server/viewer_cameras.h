// SPDX-License-Identifier: MIT
#pragma once

#include "live_session.h"
#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace tarsier::web {

// Cameras of viewers' browsers, which send their images one by one (POST
// /api/viewer-cameras/ID/frame). Sessions with such an input get the newest image. Thread-safe.
class ViewerCameras {
 public:
  static constexpr std::size_t kMaxCameras = 16;
  static constexpr std::uint64_t kMaxFrame = 16 << 20;      // bytes of a JPEG
  static constexpr std::chrono::seconds kFrameTimeout{60};  // without images; then it is removed

  // Returns the id "ab12.." of a new camera. HttpError 409 if there are too many.
  [[nodiscard]] std::string add();
  // HttpError 404; 415 if it is not a JPEG or has more than 100 MP.
  void put(const std::string& id, std::string jpeg);
  void remove(const std::string& id);  // HttpError 404
  [[nodiscard]] bool has(const std::string& id) const;
  [[nodiscard]] std::vector<std::string> ids() const;
  void attach(const std::string& id, const std::shared_ptr<LiveSession>& session);
  void remove_inactive();

 private:
  struct Camera {
    std::chrono::steady_clock::time_point last_frame_time;
    std::shared_ptr<const std::string> newest;
    std::vector<std::weak_ptr<LiveSession>> sessions;
  };
  static void end(Camera& camera);
  mutable std::mutex mutex_;
  std::map<std::string, Camera> cameras_;
};

}  // namespace tarsier::web
