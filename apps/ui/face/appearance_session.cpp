// SPDX-License-Identifier: MIT
#include "ui/face/appearance_session.h"

#include "tarsier/core/name_table.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <utility>

namespace tarsier {

namespace {

constexpr NameTable<AppearanceSession::Drawn, 4> kDrawn{
    "drawing",
    {{{AppearanceSession::Drawn::kMesh, "mesh"},
      {AppearanceSession::Drawn::kFace, "face"},
      {AppearanceSession::Drawn::kPoints, "points"},
      {AppearanceSession::Drawn::kNothing, "nothing"}}}};

constexpr double kErrorShare = 0.5;  // maximum share of the image's width for the error image

double width_of(const Eigen::Matrix2Xd& points) {
  return points.row(0).maxCoeff() - points.row(0).minCoeff();
}

}  // namespace

std::string_view name_of(AppearanceSession::Drawn drawn) { return kDrawn.name(drawn); }

AppearanceSession::AppearanceSession(face::AppearanceTracker tracker, Drawn drawn, DebugSink* debug,
                                     face::AppearanceState state)
    : FrameSession("Appearance model"),
      tracker_(std::move(tracker)),
      debug_(debug),
      state_(std::move(state)),
      drawn_(drawn) {
  const face::appearance::AppearanceModel& model = tracker_.model();
  if (model.colour || face::appearance::has_offset(model.levels.front().channels))
    synthesis_.emplace(model);
  if (!synthesis_ && drawn_ == Drawn::kFace) drawn_ = Drawn::kMesh;
}

void AppearanceSession::process(const Frame& frame) { objects_ = tracker_.process(frame, state_); }

bool AppearanceSession::act(const std::string& name) {
  if (name == "redetect") face::redetect(state_);
  if (name == "errors") errors_ = !errors_;
  if (name == "view") {
    do {
      drawn_ = static_cast<Drawn>((static_cast<int>(drawn_) + 1) % 4);
    } while (drawn_ == Drawn::kFace && !synthesis_);
  }
  return name == "view" || name == "errors";
}

std::vector<Action> AppearanceSession::own_actions() const {
  return {{"view", "mesh, the model's face, points, nothing", 'v'},
          {"errors", "what the model does not explain", 'e'},
          {"redetect", "look for faces again", 'd'}};
}

void AppearanceSession::draw_object(const Eigen::Matrix2Xd& points, Drawn drawn,
                                    cv::Mat& image) const {
  if (drawn == Drawn::kMesh) face::appearance::draw_mesh(tracker_.model(), points, image);
  if (drawn == Drawn::kPoints) {
    const double radius = std::clamp(width_of(points) / 90, 0.7, 6.0);
    for (Eigen::Index i = 0; i < points.cols(); ++i)
      image::draw::point(image, {points(0, i), points(1, i)}, {80, 220, 255}, radius);
  }
  if (drawn == Drawn::kFace) {
    const face::appearance::TextureFit seen = synthesis_->fit_texture(frame(), points);
    synthesis_->draw(seen.c, seen.offset, seen.gain, points, image);
  }
}

void AppearanceSession::processed() {
  if (watched(debug_) == nullptr) return;
  for (const Drawn drawn : {Drawn::kMesh, Drawn::kFace}) {
    if (drawn == Drawn::kFace && !synthesis_) continue;
    cv::Mat shown = frame().clone();
    for (const face::appearance::TrackedObject& object : objects_)
      draw_object(object.fit.points, drawn, shown);
    debug_->image(name_of(drawn), shown);
  }
  for (const face::appearance::TrackedObject& object : objects_)
    debug_->image(fmt::format("texture of {}", object.id),
                  face::appearance::draw_error(tracker_.model(), frame(), object.fit.points));
}

void AppearanceSession::draw(cv::Mat& image) {
  for (const face::appearance::TrackedObject& object : objects_) {
    const Eigen::Matrix2Xd& points = object.fit.points;
    draw_object(points, drawn_, image);
    if (still()) continue;
    image::draw::TextStyle text;
    text.height_px = std::clamp(width_of(points) * 0.07, 8.0, 30.0);
    image::draw::put_text(image, fmt::format("{}", object.id),
                          {cvRound(points.row(0).minCoeff()), cvRound(points.row(1).minCoeff())},
                          text, image::draw::Anchor::kBottomLeft);
  }
  if (!errors_ || objects_.empty()) return;
  cv::Mat error =
      face::appearance::draw_error(tracker_.model(), frame(), objects_.front().fit.points);
  const double scale =
      std::min({kErrorShare * image.cols / error.cols, kErrorShare * image.rows / error.rows, 3.0});
  cv::resize(error, error, {}, scale, scale, cv::INTER_LINEAR);
  error.copyTo(image(cv::Rect(0, 0, error.cols, error.rows)));
}

nlohmann::json AppearanceSession::state() const {
  nlohmann::json ids = nlohmann::json::array();
  for (const face::appearance::TrackedObject& object : objects_) ids.push_back(object.id);
  return {{"faces", objects_.size()},
          {"ids", std::move(ids)},
          {"error", objects_.empty() ? 1 : objects_.front().fit.error},
          {"drawn", name_of(drawn_)}};
}

std::string AppearanceSession::status() const {
  return counted(objects_.size(), "face") +
         (objects_.empty() ? "" : fmt::format("  error {:.2f}", objects_.front().fit.error));
}

}  // namespace tarsier
