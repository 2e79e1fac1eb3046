// SPDX-License-Identifier: MIT
#include "tarsier/session/appearance_session.h"

#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <utility>

namespace tarsier {

namespace {

constexpr double kErrorShare = 0.5;  // of the picture's width that the error picture may take

double width_of(const Eigen::Matrix2Xd& points) {
  return points.row(0).maxCoeff() - points.row(0).minCoeff();
}

}  // namespace

std::string_view name_of(AppearanceSession::Drawn drawn) {
  switch (drawn) {
    case AppearanceSession::Drawn::kMesh:
      return "mesh";
    case AppearanceSession::Drawn::kFace:
      return "face";
    case AppearanceSession::Drawn::kPoints:
      return "points";
    case AppearanceSession::Drawn::kNothing:
      return "nothing";
  }
  return "";
}

AppearanceSession::AppearanceSession(const face::appearance::Fitter& fitter,
                                     face::appearance::FindStarts find,
                                     const face::appearance::TrackOptions& options, Drawn drawn,
                                     DebugSink* debug)
    : fitter_(fitter), find_(std::move(find)), options_(options), debug_(debug), drawn_(drawn) {
  options_.check();
  const face::appearance::AppearanceModel& model = fitter.model();
  if (model.colour || face::appearance::has_offset(model.levels.front().channels))
    synthesis_.emplace(model);
  if (!synthesis_ && drawn_ == Drawn::kFace) drawn_ = Drawn::kMesh;
}

View AppearanceSession::on_frame(const Frame& frame, const SourceStatus& source) {
  if (frame.still || frame.name != name_) track_ = {};
  frame_ = frame.image;
  still_ = frame.still;
  name_ = frame.name;
  source_ = source.state == SourceState::kLive ? "" : std::string(name_of(source.state));
  timer_.start();
  objects_ =
      still_
          ? face::appearance::find_objects(fitter_, find_, frame_, options_.max_objects, workspace_)
          : face::appearance::track_objects(fitter_, options_, find_, track_, frame_, frame.time);
  timer_.stop();
  if (debug_ != nullptr) show_stages();
  draw();
  return view(true);
}

View AppearanceSession::on_idle(const SourceStatus& source) {
  source_ = source.state == SourceState::kLive ? "" : std::string(name_of(source.state));
  return view(false);
}

View AppearanceSession::on_event(const Event& event) {
  const std::string name = action_of(event, actions());
  const bool redraws = name == "view" || name == "errors";
  if (name == "quit") finished_ = true;
  if (name == "pause") paused_ = !paused_;
  if (name == "help") help_ = !help_;
  if (name == "redetect") track_ = {};
  if (name == "errors") errors_ = !errors_;
  if (name == "view") {
    do {
      drawn_ = static_cast<Drawn>((static_cast<int>(drawn_) + 1) % 4);
    } while (drawn_ == Drawn::kFace && !synthesis_);
  }
  if (redraws && !frame_.empty()) draw();
  return view(redraws && !frame_.empty() && still_);
}

std::vector<Action> AppearanceSession::actions() const {
  return {{"view", "mesh, the model's face, points, nothing", 'v'},
          {"errors", "what the model does not explain", 'e'},
          {"redetect", "look for faces again", 'd'},
          {"pause", "pause and go on", key::kSpace},
          {"help", "this list", 'h'},
          {"quit", "end", 'q'}};
}

void AppearanceSession::draw_object(const Eigen::Matrix2Xd& points, Drawn drawn,
                                    cv::Mat& image) const {
  if (drawn == Drawn::kMesh) face::appearance::draw_mesh(fitter_.model(), points, image);
  if (drawn == Drawn::kPoints) {
    const double radius = std::clamp(width_of(points) / 90, 0.7, 6.0);
    for (Eigen::Index i = 0; i < points.cols(); ++i)
      image::draw::point(image, {points(0, i), points(1, i)}, {80, 220, 255}, radius);
  }
  if (drawn == Drawn::kFace) {
    const face::appearance::Explained seen = synthesis_->explain(frame_, points);
    synthesis_->draw(seen.c, seen.offset, seen.gain, points, image);
  }
}

void AppearanceSession::show_stages() {
  for (const Drawn drawn : {Drawn::kMesh, Drawn::kFace}) {
    if (drawn == Drawn::kFace && !synthesis_) continue;
    cv::Mat shown = frame_.clone();
    for (const face::appearance::TrackedObject& object : objects_)
      draw_object(object.fit.points, drawn, shown);
    debug_->image(name_of(drawn), shown);
  }
  for (const face::appearance::TrackedObject& object : objects_)
    debug_->image(fmt::format("texture of {}", object.id),
                  face::appearance::draw_error(fitter_.model(), frame_, object.fit.points));
}

void AppearanceSession::draw() {
  frame_.copyTo(output_);
  for (const face::appearance::TrackedObject& object : objects_) {
    const Eigen::Matrix2Xd& points = object.fit.points;
    draw_object(points, drawn_, output_);
    if (still_) continue;
    image::draw::TextStyle text;
    text.height_px = std::clamp(width_of(points) * 0.07, 8.0, 30.0);
    image::draw::put_text(output_, fmt::format("{}", object.id),
                          {cvRound(points.row(0).minCoeff()), cvRound(points.row(1).minCoeff())},
                          text, image::draw::Anchor::kBottomLeft);
  }
  if (!errors_ || objects_.empty()) return;
  cv::Mat error =
      face::appearance::draw_error(fitter_.model(), frame_, objects_.front().fit.points);
  const double scale = std::min(
      {kErrorShare * output_.cols / error.cols, kErrorShare * output_.rows / error.rows, 3.0});
  cv::resize(error, error, {}, scale, scale, cv::INTER_LINEAR);
  error.copyTo(output_(cv::Rect(0, 0, error.cols, error.rows)));
}

View AppearanceSession::view(bool fresh) {
  View result;
  nlohmann::json ids = nlohmann::json::array();
  for (const face::appearance::TrackedObject& object : objects_) ids.push_back(object.id);
  const double error = objects_.empty() ? 1 : objects_.front().fit.error;
  result.state = {{"faces", objects_.size()},
                  {"ids", std::move(ids)},
                  {"error", error},
                  {"drawn", name_of(drawn_)},
                  {"paused", paused_}};
  result.status =
      fmt::format("{} {}{}{}{}", objects_.size(), objects_.size() == 1 ? "face" : "faces",
                  objects_.empty() ? "" : fmt::format("  error {:.2f}", error),
                  source_.empty() ? "" : "  " + source_, paused_ ? "  paused" : "");
  if (fresh) result.output = output_;
  if (!output_.empty()) {
    output_.copyTo(shown_);
    image::draw::status_bar(shown_, result.status, timer_.words(still_) + "   h: help");
    if (help_) draw_help(shown_, "Appearance model", actions());
    result.image = shown_;
  }
  result.finished = finished_;
  return result;
}

}  // namespace tarsier
