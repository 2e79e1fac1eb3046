// SPDX-License-Identifier: MIT
#include "tarsier/session/landmark_session.h"

#include "tarsier/face/shape/show.h"
#include "tarsier/image/draw/text.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

namespace tarsier {

LandmarkSession::LandmarkSession(face::LandmarkTracker tracker, DebugSink* debug)
    : tracker_(std::move(tracker)), debug_(debug) {}

View LandmarkSession::on_frame(const Frame& frame, const SourceStatus& source) {
  frame_ = frame.image;
  source_ = source.state == SourceState::kLive ? "" : std::string(name_of(source.state));
  timer_.start();
  result_ = tracker_.process(frame, state_, debug_);
  timer_.stop();
  draw();
  return view(true);
}

View LandmarkSession::on_idle(const SourceStatus& source) {
  source_ = source.state == SourceState::kLive ? "" : std::string(name_of(source.state));
  return view(false);
}

View LandmarkSession::on_event(const Event& event) {
  const std::string name = action_of(event, actions());
  if (name == "quit") finished_ = true;
  if (name == "pause") paused_ = !paused_;
  if (name == "help") help_ = !help_;
  if (name == "redetect") face::redetect(state_);
  if (name == "smooth") {
    face::landmarks::TrackerOptions tracking = tracker_.tracking();
    tracking.smoothing = !tracking.smoothing;
    tracker_.set_tracking(tracking);
  }
  if (name == "numbers") {
    numbers_ = !numbers_;
    if (!frame_.empty()) draw();
  }
  return view(name == "numbers" && !frame_.empty() && !result_.tracked);
}

std::vector<Action> LandmarkSession::actions() const {
  return {{"redetect", "look for faces again", 'd'},
          {"numbers", "numbers of the points", 'n'},
          {"smooth", "smoothing on and off", 's'},
          {"pause", "pause and go on", key::kSpace},
          {"help", "this list", 'h'},
          {"quit", "end", 'q'}};
}

void LandmarkSession::draw() {
  frame_.copyTo(output_);
  face::shape::LandmarkStyle style;
  style.numbers = numbers_;
  const face::shape::ShapeModel& shape = tracker_.model().shape;
  for (const face::landmarks::TrackedFace& face : result_.faces) {
    style.radius_px = std::clamp(face.box.width / 90, 0.7, 6.0);
    face::shape::draw_landmarks(output_, face.points, shape.connections, shape.mirror, style);
    if (!result_.tracked) continue;
    image::draw::TextStyle text;
    text.height_px = std::clamp(face.box.height * 0.07, 8.0, 30.0);
    image::draw::put_text(output_, fmt::format("{}", face.id),
                          {cvRound(face.box.x), cvRound(face.box.y)}, text,
                          image::draw::Anchor::kBottomLeft);
  }
}

View LandmarkSession::view(bool fresh) {
  View result;
  nlohmann::json ids = nlohmann::json::array();
  for (const face::landmarks::TrackedFace& face : result_.faces) ids.push_back(face.id);
  result.state = {{"faces", result_.faces.size()},
                  {"ids", std::move(ids)},
                  {"smoothing", tracker_.tracking().smoothing},
                  {"paused", paused_}};
  result.status =
      fmt::format("{} {}{}{}", result_.faces.size(), result_.faces.size() == 1 ? "face" : "faces",
                  source_.empty() ? "" : "  " + source_, paused_ ? "  paused" : "");
  if (fresh) result.output = output_;
  if (!output_.empty()) {
    output_.copyTo(shown_);
    image::draw::status_bar(shown_, result.status, timer_.words(!result_.tracked) + "   h: help");
    if (help_) draw_help(shown_, "Landmarks", actions());
    result.image = shown_;
  }
  result.finished = finished_;
  return result;
}

}  // namespace tarsier
