// SPDX-License-Identifier: MIT
#include "ui/face/appearance_session.h"

#include "tarsier/core/name_table.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier {

namespace {

constexpr NameTable<AppearanceSession::Overlay, 4> kAppearanceOverlays{
    "drawing",
    {{{AppearanceSession::Overlay::kMesh, "mesh"},
      {AppearanceSession::Overlay::kFace, "face"},
      {AppearanceSession::Overlay::kPoints, "points"},
      {AppearanceSession::Overlay::kNothing, "nothing"}}}};

constexpr double kErrorShare = 0.5;  // maximum share of the image's width for the error image

double width_of(const Eigen::Matrix2Xd& points) {
  return points.row(0).maxCoeff() - points.row(0).minCoeff();
}

}  // namespace

std::string_view name_of(AppearanceSession::Overlay overlay) {
  return kAppearanceOverlays.name(overlay);
}

AppearanceSession::AppearanceSession(face::AppearanceTracker tracker, Overlay overlay,
                                     DebugSink* debug, face::AppearanceState state)
    : FrameSession("Appearance model"),
      tracker_(std::move(tracker)),
      debug_(debug),
      state_(std::move(state)),
      overlay_(overlay) {
  const face::appearance::AppearanceModel& model = tracker_.model();
  if (model.colour || face::appearance::has_offset(model.levels.front().channels))
    synthesis_.emplace(model);
  if (!synthesis_ && overlay_ == Overlay::kFace) overlay_ = Overlay::kMesh;
}

void AppearanceSession::process(const Frame& frame) { objects_ = tracker_.process(frame, state_); }

bool AppearanceSession::act(const std::string& name) {
  if (name == "redetect") face::redetect(state_);
  if (name == "errors") shows_error_ = !shows_error_;
  if (name == "view") {
    do {
      overlay_ = static_cast<Overlay>((static_cast<int>(overlay_) + 1) % 4);
    } while (overlay_ == Overlay::kFace && !synthesis_);
  }
  return name == "view" || name == "errors";
}

std::vector<Action> AppearanceSession::own_actions() const {
  return {{"view", "choose the overlay: mesh, model, points, none", 'v'},
          {"errors", "show the residual of the model", 'e'},
          {"redetect", "detect faces again", 'd'}};
}

void AppearanceSession::draw_object(const Eigen::Matrix2Xd& points, Overlay overlay,
                                    cv::Mat& image) const {
  if (overlay == Overlay::kMesh) face::appearance::draw_mesh(tracker_.model(), points, image);
  if (overlay == Overlay::kPoints) {
    const double radius = std::clamp(width_of(points) / 90, 0.7, 6.0);
    for (Eigen::Index i = 0; i < points.cols(); ++i)
      image::draw::point(image, {points(0, i), points(1, i)}, {80, 220, 255}, radius);
  }
  if (overlay == Overlay::kFace) {
    const face::appearance::TextureFit seen = synthesis_->fit_texture(frame(), points);
    synthesis_->draw(seen.c, seen.offset, seen.gain, points, image);
  }
}

void AppearanceSession::on_processed() {
  if (watched(debug_) == nullptr) return;
  for (const Overlay overlay : {Overlay::kMesh, Overlay::kFace}) {
    if (overlay == Overlay::kFace && !synthesis_) continue;
    cv::Mat shown = frame().clone();
    for (const face::appearance::TrackedObject& object : objects_)
      draw_object(object.fit.points, overlay, shown);
    debug_->image(name_of(overlay), shown);
  }
  for (const face::appearance::TrackedObject& object : objects_)
    debug_->image(fmt::format("texture of {}", object.id),
                  face::appearance::draw_error(tracker_.model(), frame(), object.fit.points));
}

void AppearanceSession::draw(cv::Mat& image) {
  for (const face::appearance::TrackedObject& object : objects_) {
    const Eigen::Matrix2Xd& points = object.fit.points;
    draw_object(points, overlay_, image);
    if (still()) continue;
    image::draw::TextStyle text;
    text.height_px = std::clamp(width_of(points) * 0.07, 8.0, 30.0);
    image::draw::put_text(image, fmt::format("{}", object.id),
                          {cvRound(points.row(0).minCoeff()), cvRound(points.row(1).minCoeff())},
                          text, image::draw::Anchor::kBottomLeft);
  }
  if (!shows_error_ || objects_.empty()) return;
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
          {"drawn", name_of(overlay_)}};
}

std::string AppearanceSession::status() const {
  return count_text(objects_.size(), "face") +
         (objects_.empty() ? "" : fmt::format("  error {:.2f}", objects_.front().fit.error));
}

}  // namespace tarsier
