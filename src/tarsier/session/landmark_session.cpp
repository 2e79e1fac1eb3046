// SPDX-License-Identifier: MIT
#include "tarsier/session/landmark_session.h"

#include "tarsier/draw/text.h"
#include "tarsier/shape/show.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <utility>

namespace tarsier {

LandmarkSession::LandmarkSession(const landmarks::LandmarkModel& model,
                                 const landmarks::FitOptions& fit, landmarks::FaceFinder finder,
                                 const landmarks::TrackerOptions& options, DebugSink* debug)
    : model_(model), fit_(fit), finder_(std::move(finder)), options_(options), debug_(debug) {
  fit_.check();
  options_.check();
}

View LandmarkSession::on_frame(const Frame& frame, const SourceStatus& source) {
  if (frame.still || frame.name != name_) state_ = {};
  frame_ = frame.image;
  still_ = frame.still;
  name_ = frame.name;
  source_ = source.state == SourceState::kLive ? "" : std::string(name_of(source.state));
  timer_.start();
  cv::cvtColor(frame.image, gray_, cv::COLOR_BGR2GRAY);
  if (still_) {
    faces_.clear();
    for (landmarks::FoundFace& face : landmarks::find_faces(
             model_, fit_, gray_, finder_, workspace_, options_.least_new, debug_)) {
      faces_.push_back({static_cast<int>(faces_.size()) + 1, std::move(face.fit.points),
                        face.fit.score, face.box});
    }
  } else {
    faces_ = landmarks::track_faces(model_, fit_, options_, finder_, state_, gray_, frame.time,
                                    workspace_, debug_);
  }
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
  if (name == "redetect") landmarks::redetect(state_);
  if (name == "smooth") options_.smoothing = !options_.smoothing;
  if (name == "numbers") {
    numbers_ = !numbers_;
    if (!frame_.empty()) draw();
  }
  return view(name == "numbers" && !frame_.empty() && still_);
}

std::vector<Action> LandmarkSession::actions() const {
  return {{"redetect", "look for faces anew", 'd'},
          {"numbers", "numbers of the points", 'n'},
          {"smooth", "smoothing on and off", 's'},
          {"pause", "pause and go on", key::kSpace},
          {"help", "this list", 'h'},
          {"quit", "end", 'q'}};
}

void LandmarkSession::draw() {
  frame_.copyTo(output_);
  shape::LandmarkStyle style;
  style.numbers = numbers_;
  for (const landmarks::TrackedFace& face : faces_) {
    style.radius_px = std::clamp(face.box.width / 90, 0.7, 6.0);
    shape::draw_landmarks(output_, face.points, model_.shape.connections, model_.shape.mirror,
                          style);
    if (still_) continue;
    draw::TextStyle text;
    text.height_px = std::clamp(face.box.height * 0.07, 8.0, 30.0);
    draw::put_text(output_, fmt::format("{}", face.id), {cvRound(face.box.x), cvRound(face.box.y)},
                   text, draw::Anchor::kBottomLeft);
  }
}

View LandmarkSession::view(bool fresh) {
  View result;
  nlohmann::json ids = nlohmann::json::array();
  for (const landmarks::TrackedFace& face : faces_) ids.push_back(face.id);
  result.state = {{"faces", faces_.size()},
                  {"ids", std::move(ids)},
                  {"smoothing", options_.smoothing},
                  {"paused", paused_}};
  result.status = fmt::format("{} {}{}{}", faces_.size(), faces_.size() == 1 ? "face" : "faces",
                              source_.empty() ? "" : "  " + source_, paused_ ? "  paused" : "");
  if (fresh) result.output = output_;
  if (!output_.empty()) {
    output_.copyTo(shown_);
    draw::status_bar(shown_, result.status, timer_.words(still_) + "   h: help");
    if (help_) draw_help(shown_, "Landmarks", actions());
    result.image = shown_;
  }
  result.finished = finished_;
  return result;
}

}  // namespace tarsier
