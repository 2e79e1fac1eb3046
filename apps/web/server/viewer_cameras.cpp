// SPDX-License-Identifier: MIT
#include "viewer_cameras.h"

#include "tarsier/media/image_probe.h"

#include <fmt/format.h>

#include "router.h"
#include "secrets.h"
#include <span>

namespace tarsier::web {
namespace {

using Clock = std::chrono::steady_clock;

}  // namespace

std::string ViewerCameras::add() {
  remove_inactive();
  const std::lock_guard lock(mutex_);
  if (cameras_.size() >= kMaxCameras)
    throw HttpError(409, fmt::format("the limit of {} browser cameras is reached; close one first",
                                     kMaxCameras));
  std::string id = new_secret().substr(0, 12);
  cameras_[id].last_frame_time = Clock::now();
  return id;
}

void ViewerCameras::put(const std::string& id, std::string jpeg) {
  const std::span<const std::uint8_t> bytes(reinterpret_cast<const std::uint8_t*>(jpeg.data()),
                                            jpeg.size());
  const auto header = probe_image(bytes);
  if (!header || jpeg.compare(0, 2, "\xff\xd8") != 0)
    throw HttpError(415, "the frame is not a JPEG image");
  if (static_cast<std::int64_t>(header->width) * header->height > 100'000'000)
    throw HttpError(415, "the frame has more than 100 million pixels");
  auto frame = std::make_shared<const std::string>(std::move(jpeg));
  std::vector<std::shared_ptr<LiveSession>> sessions;
  {
    const std::lock_guard lock(mutex_);
    const auto found = cameras_.find(id);
    if (found == cameras_.end())
      throw HttpError(404, "this camera was closed; open another (POST /api/viewer-cameras)");
    Camera& camera = found->second;
    camera.last_frame_time = Clock::now();
    camera.newest = frame;
    std::erase_if(camera.sessions, [](const auto& session) { return session.expired(); });
    for (const auto& session : camera.sessions) {
      if (auto alive = session.lock()) sessions.push_back(std::move(alive));
    }
  }
  for (const auto& session : sessions) session->offer_frame(frame);
}

void ViewerCameras::end(Camera& camera) {
  for (const auto& session : camera.sessions) {
    if (const auto alive = session.lock()) alive->end_camera();
  }
}

void ViewerCameras::remove(const std::string& id) {
  Camera camera;
  {
    const std::lock_guard lock(mutex_);
    const auto found = cameras_.find(id);
    if (found == cameras_.end()) throw HttpError(404, "no such camera");
    camera = std::move(found->second);
    cameras_.erase(found);
  }
  end(camera);
}

bool ViewerCameras::has(const std::string& id) const {
  const std::lock_guard lock(mutex_);
  return cameras_.contains(id);
}

std::vector<std::string> ViewerCameras::ids() const {
  const std::lock_guard lock(mutex_);
  std::vector<std::string> result;
  for (const auto& [id, camera] : cameras_) result.push_back(id);
  return result;
}

void ViewerCameras::attach(const std::string& id, const std::shared_ptr<LiveSession>& session) {
  std::shared_ptr<const std::string> newest;
  {
    const std::lock_guard lock(mutex_);
    const auto found = cameras_.find(id);
    if (found == cameras_.end()) {
      session->end_camera();
      return;
    }
    found->second.sessions.push_back(session);
    newest = found->second.newest;
  }
  if (newest != nullptr) session->offer_frame(std::move(newest));
}

void ViewerCameras::remove_inactive() {
  std::vector<Camera> silent;
  {
    const std::lock_guard lock(mutex_);
    for (auto camera = cameras_.begin(); camera != cameras_.end();) {
      if (Clock::now() - camera->second.last_frame_time < kFrameTimeout) {
        ++camera;
        continue;
      }
      silent.push_back(std::move(camera->second));
      camera = cameras_.erase(camera);
    }
  }
  for (Camera& camera : silent) end(camera);
}

}  // namespace tarsier::web
