// SPDX-License-Identifier: MIT
#include "tarsier/session/ar_session.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/geometry/frame_camera.h"
#include "tarsier/geometry/rotation.h"
#include "tarsier/geometry/scaled_camera.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/planar/markers/predefined.h"
#include "tarsier/session/save_picture.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <utility>

namespace tarsier {
namespace {

using planar::augment::Thing;
using planar::markers::PosedMarker;

const cv::Scalar kFrame(60, 220, 60);
const cv::Scalar kFirstCorner(40, 40, 240);
constexpr double kMessage_s = 3;
constexpr int kMaxListed = 12;

// What the key goes through.
const std::vector<std::string>& common_families() {
  static const std::vector<std::string> names{"36h11",    "aruco-original", "4x4_1000", "5x5_1000",
                                              "6x6_1000", "7x7_1000",       "25h9"};
  return names;
}

double rounded(double value, double digits) { return std::round(value * digits) / digits; }

std::vector<planar::markers::Marker> found_by_opencv(const cv::Mat& gray,
                                                     const std::string& family) {
  std::vector<planar::markers::Marker> markers;
  for (const planar::markers::OpencvMarker& found :
       planar::markers::detect_with_opencv(gray, family)) {
    if (found.corners.size() != 4) continue;
    planar::markers::Marker marker;
    marker.id = found.id;
    for (std::size_t k = 0; k < 4; ++k)
      marker.corners[k] = {static_cast<double>(found.corners[k].x),
                           static_cast<double>(found.corners[k].y)};
    markers.push_back(marker);
  }
  return markers;
}

double distance_of(const PosedMarker& marker) {
  return cv::norm(marker.pose->camera_from_marker.translation);
}

// Degrees between the sheet's normal and the line of sight.
double tilt_of(const PosedMarker& marker) {
  const geometry::Rigid& pose = marker.pose->camera_from_marker;
  const cv::Vec3d normal = pose.rotation * cv::Vec3d(0, 0, 1);
  const double cosine = -normal.dot(cv::normalize(pose.translation));
  return std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / CV_PI;
}

nlohmann::ordered_json numbers(const cv::Vec3d& v) {
  return {rounded(v[0], 1e7), rounded(v[1], 1e7), rounded(v[2], 1e7)};
}

}  // namespace

void ArSessionOptions::check() const {
  (void)planar::markers::find_dictionary(family);
  TARSIER_REQUIRE(size > 0 && std::isfinite(size), "markers {} m wide", size);
  TARSIER_REQUIRE(focal_px >= 0 && std::isfinite(focal_px), "focal length of {}", focal_px);
  detect.check();
  track.check();
  augment.check();
}

ArSession::ArSession(ArSessionOptions options)
    : options_((options.check(), std::move(options))),
      family_(&planar::markers::find_dictionary(options_.family)),
      tracker_(options_.track) {}

geometry::Camera ArSession::camera_for(const Frame& frame) const {
  if (!options_.camera) {
    geometry::Camera guess = geometry::guessed_camera(frame.image.size());
    if (options_.focal_px > 0) guess.fx = guess.fy = options_.focal_px;
    return guess;
  }
  return geometry::camera_of_frame(*options_.camera, frame);
}

void ArSession::find(const Frame& frame) {
  timer_.start();
  cv::cvtColor(frame.image, gray_, cv::COLOR_BGR2GRAY);
  std::vector<planar::markers::Marker> found =
      options_.backend == MarkerBackend::kOwn
          ? planar::markers::detect_markers(gray_, *family_, options_.detect, workspace_,
                                            options_.debug)
          : found_by_opencv(gray_, family_->name());
  markers_ = frame.still ? planar::markers::pose_markers(std::move(found), options_.size, camera_)
                         : tracker_.step(std::move(found), options_.size, camera_, frame.time);
  timer_.stop();
}

View ArSession::on_frame(const Frame& frame, const SourceStatus& source) {
  if (frame.still || frame.name != frame_.name) {
    tracker_.reset();
    augment_ = {};
  }
  frame_ = frame;
  source_ = source.state == SourceState::kLive ? "" : std::string(tarsier::name_of(source.state));
  camera_ = camera_for(frame);
  find(frame);
  draw();
  return view(true);
}

View ArSession::on_idle(const SourceStatus& source) {
  source_ = source.state == SourceState::kLive ? "" : std::string(tarsier::name_of(source.state));
  return view(false);
}

View ArSession::on_event(const Event& event) {
  const std::string name = action_of(event, actions());
  const auto things = planar::augment::thing_named(name);
  bool redraw = true;
  if (things && (*things != Thing::kMesh || options_.augment.mesh != nullptr)) {
    options_.augment.thing = *things;
  } else if (name == "outlines") {
    options_.outlines = !options_.outlines;
  } else if (name == "shadow") {
    options_.augment.shadow = !options_.augment.shadow;
  } else if (name == "smooth") {
    options_.track.smooth = !options_.track.smooth;
    tracker_.set_options(options_.track);
  } else if (name == "list") {
    list_ = !list_;
  } else if (name == "family") {
    const auto& names = common_families();
    const auto at = std::find(names.begin(), names.end(), family_->name());
    set_family(at == names.end() || std::next(at) == names.end() ? names.front() : *std::next(at));
  } else {
    redraw = false;
    if (name == "save") save();
    if (name == "pause") paused_ = !paused_;
    if (name == "help") help_ = !help_;
    if (name == "quit") finished_ = true;
  }
  if (redraw && !frame_.image.empty()) draw();
  return view(redraw && frame_.still && !frame_.image.empty());
}

std::vector<Action> ArSession::actions() const {
  std::vector<Action> actions{
      {"axes", "axes", 'a'}, {"cube", "a cube", 'c'}, {"none", "nothing on them", 'n'}};
  if (options_.augment.mesh != nullptr) actions.push_back({"mesh", "the mesh", 'm'});
  const std::vector<Action> more{{"outlines", "outlines and ids", 'i'},
                                 {"shadow", "shadows", 'e'},
                                 {"smooth", "smoothing", 's'},
                                 {"list", "list with distances", 'l'},
                                 {"family", "next family", 'f'},
                                 {"save", "save the picture", 'w'},
                                 {"pause", "freeze and go on", key::kSpace},
                                 {"help", "this list", 'h'},
                                 {"quit", "end", 'q'}};
  actions.insert(actions.end(), more.begin(), more.end());
  return actions;
}

void ArSession::set_family(const std::string& name) {
  family_ = &planar::markers::find_dictionary(name);
  options_.family = name;
  tracker_.reset();
  augment_ = {};
  if (!frame_.image.empty()) find(frame_);
}

void ArSession::save() {
  if (output_.empty()) return;
  message_since_ = frame_.time;
  try {
    saved_ = save_numbered(options_.save_folder, output_);
    message_ = "saved " + saved_;
  } catch (const OutputError& error) {  // no reason to end a live picture
    log_warning("cannot save: {}", error.what());
    message_ = "cannot save: see the log";
  }
}

void ArSession::draw_outlines() {
  for (const PosedMarker& posed : markers_) {
    const planar::markers::Quad& quad = posed.marker.corners;
    constexpr int kShift = 4;
    const auto fixed = [](const Eigen::Vector2d& p) {
      return cv::Point(cvRound(p.x() * (1 << kShift)), cvRound(p.y() * (1 << kShift)));
    };
    for (std::size_t k = 0; k < 4; ++k) {
      cv::line(output_, fixed(quad[k]), fixed(quad[(k + 1) % 4]), kFrame, 2, cv::LINE_AA, kShift);
    }
    const double side = (quad[1] - quad[0]).norm();
    image::draw::point(output_, {quad[0].x(), quad[0].y()}, kFirstCorner,
                       std::clamp(side * 0.06, 2.0, 6.0));
    const Eigen::Vector2d middle = 0.25 * (quad[0] + quad[1] + quad[2] + quad[3]);
    image::draw::TextStyle style;
    style.height_px = std::clamp(side * 0.22, 8.0, 28.0);
    image::draw::put_text(output_, std::to_string(posed.marker.id),
                          {cvRound(middle.x()), cvRound(middle.y())}, style,
                          image::draw::Anchor::kCenter);
  }
}

void ArSession::draw() {
  frame_.image.copyTo(output_);
  std::vector<planar::augment::Sheet> sheets;
  std::map<int, int> seen;  // of two markers with one id each has a key of its own
  for (const PosedMarker& posed : markers_) {
    if (!posed.pose) continue;
    const int copy = seen[posed.marker.id]++;
    sheets.push_back(
        {posed.marker.id + 100000 * copy, posed.pose->camera_from_marker, options_.size});
  }
  // Under the things, which would be hard to see behind the letters.
  if (options_.outlines) draw_outlines();
  planar::augment::augment(output_, camera_, sheets, options_.augment, augment_);
}

void ArSession::draw_list() {
  std::string text;
  int listed = 0;
  for (const PosedMarker& posed : markers_) {
    if (++listed > kMaxListed) {
      text += fmt::format("and {} more", markers_.size() - kMaxListed);
      break;
    }
    text += posed.pose ? fmt::format("{}: {:.3f} m, {:.0f} deg\n", posed.marker.id,
                                     distance_of(posed), tilt_of(posed))
                       : fmt::format("{}: no pose\n", posed.marker.id);
  }
  if (text.empty()) text = "no markers\n";
  if (text.back() == '\n') text.pop_back();
  image::draw::TextStyle style;
  style.backing = image::draw::Backing::kBox;
  style.height_px = std::max(8.0, 0.7 * image::draw::fitting_text_height(shown_.size()));
  image::draw::put_text(shown_, text, {6, 6}, style);
}

View ArSession::view(bool fresh) {
  View result;
  nlohmann::json ids = nlohmann::json::array();
  nlohmann::json distances = nlohmann::json::array();
  for (const PosedMarker& posed : markers_) {
    ids.push_back(posed.marker.id);
    distances.push_back(posed.pose ? nlohmann::json(rounded(distance_of(posed), 1e4)) : nullptr);
  }
  result.state = {{"markers", markers_.size()},
                  {"ids", std::move(ids)},
                  {"distance_m", std::move(distances)},
                  {"draw", planar::augment::name_of(options_.augment.thing)},
                  {"outlines", options_.outlines},
                  {"shadow", options_.augment.shadow},
                  {"smooth", options_.track.smooth},
                  {"list", list_},
                  {"family", family_->name()},
                  {"paused", paused_}};
  if (!saved_.empty()) result.state["saved"] = saved_;
  const bool speaks = !message_.empty() && frame_.time - message_since_ < kMessage_s;
  result.status = fmt::format("{} {} of {}{}{}", markers_.size(),
                              markers_.size() == 1 ? "marker" : "markers", family_->name(),
                              source_.empty() ? "" : "  " + source_, paused_ ? "  frozen" : "");
  if (fresh) result.output = output_;
  if (!output_.empty()) {
    output_.copyTo(shown_);
    if (list_) draw_list();
    const double ms = frame_.still ? timer_.last_ms() : timer_.usual_ms();
    image::draw::status_bar(shown_, speaks ? message_ : result.status,
                            fmt::format("{:.1f} ms   h: help", ms));
    if (help_) draw_help(shown_, "Markers", actions());
    result.image = shown_;
  }
  result.finished = finished_;
  return result;
}

nlohmann::ordered_json posed_markers_json(const std::vector<PosedMarker>& markers) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const PosedMarker& posed : markers) {
    nlohmann::ordered_json object{{"id", posed.marker.id}};
    object["corners"] = nlohmann::ordered_json::array();
    for (const Eigen::Vector2d& p : posed.marker.corners)
      object["corners"].push_back({rounded(p.x(), 1e4), rounded(p.y(), 1e4)});
    if (posed.pose) {
      const geometry::Rigid& pose = posed.pose->camera_from_marker;
      object["rvec"] = numbers(geometry::rotation_vector(pose.rotation));
      object["tvec"] = numbers(pose.translation);
      object["errors"] = {rounded(posed.pose->rms_px, 1e4)};
      if (posed.pose->other) object["errors"].push_back(rounded(posed.pose->other->rms_px, 1e4));
      object["ambiguity"] = rounded(posed.pose->ambiguity, 1e4);
    }
    object["margin"] = rounded(posed.marker.margin, 1e4);
    list.push_back(std::move(object));
  }
  return list;
}

}  // namespace tarsier
