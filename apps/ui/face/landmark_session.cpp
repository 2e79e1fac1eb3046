// SPDX-License-Identifier: MIT
#include "ui/face/landmark_session.h"

#include "tarsier/face/shape/show.h"
#include "tarsier/image/draw/text.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier {

LandmarkSession::LandmarkSession(face::LandmarkTracker tracker, DebugSink* debug)
    : FrameSession("Landmarks"), tracker_(std::move(tracker)), debug_(debug) {}

void LandmarkSession::process(const Frame& frame) {
  result_ = tracker_.process(frame, state_, watched(debug_));
}

bool LandmarkSession::act(const std::string& name) {
  if (name == "redetect") face::redetect(state_);
  if (name == "smooth") {
    face::landmarks::TrackerOptions tracking = tracker_.tracking();
    tracking.smoothing = !tracking.smoothing;
    tracker_.set_tracking(tracking);
  }
  if (name == "sigma") {
    sigmas_ = !sigmas_;
    return true;
  }
  if (name != "numbers") return false;
  numbers_ = !numbers_;
  return true;
}

std::vector<Action> LandmarkSession::own_actions() const {
  return {{"redetect", "detect faces again", 'd'},
          {"numbers", "show point numbers", 'n'},
          {"sigma", "show uncertainty: circles of one standard deviation", 'u'},
          {"smooth", "smoothing on or off", 's'}};
}

void LandmarkSession::draw(cv::Mat& image) {
  face::shape::LandmarkStyle style;
  style.numbers = numbers_;
  const face::shape::ShapeModel& shape = tracker_.model().shape;
  for (const face::landmarks::TrackedFace& face : result_.faces) {
    style.radius_px = std::clamp(face.box.width / 90, 0.7, 6.0);
    style.hidden = face.visibility.hidden();
    style.sigma_px = face.visibility.sigma_px;
    style.all_sigmas = sigmas_;
    face::shape::draw_landmarks(image, face.points, shape.connections, shape.mirror, style);
    if (!result_.tracked) continue;
    image::draw::TextStyle text;
    text.height_px = std::clamp(face.box.height * 0.07, 8.0, 30.0);
    image::draw::put_text(image, fmt::format("{}", face.id),
                          {cvRound(face.box.x), cvRound(face.box.y)}, text,
                          image::draw::Anchor::kBottomLeft);
  }
}

nlohmann::json LandmarkSession::state() const {
  nlohmann::json ids = nlohmann::json::array();
  for (const face::landmarks::TrackedFace& face : result_.faces) ids.push_back(face.id);
  return {{"faces", result_.faces.size()},
          {"ids", std::move(ids)},
          {"smoothing", tracker_.tracking().smoothing}};
}

std::string LandmarkSession::status() const { return count_text(result_.faces.size(), "face"); }

}  // namespace tarsier
