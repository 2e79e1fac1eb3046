// SPDX-License-Identifier: MIT
#include "tarsier/session/ar_session.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/media/still_source.h"
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

using planar::TrackedMarker;
using planar::augment::Object;

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

double distance_of(const TrackedMarker& marker) {
  return cv::norm(marker.pose->camera_from_marker.translation);
}

// Degrees between the sheet's normal and the line of sight.
double tilt_of(const TrackedMarker& marker) {
  const geometry::Rigid& pose = marker.pose->camera_from_marker;
  const cv::Vec3d normal = pose.rotation * cv::Vec3d(0, 0, 1);
  const double cosine = -normal.dot(cv::normalize(pose.translation));
  return std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / CV_PI;
}

}  // namespace

void ArSessionOptions::check() const { augment.check(); }

ArSession::ArSession(planar::MarkerTracker tracker, ArSessionOptions options)
    : options_((options.check(), std::move(options))), tracker_(std::move(tracker)) {}

void ArSession::find() {
  timer_.start();
  result_ = tracker_.process(frame_, state_, options_.debug);
  timer_.stop();
}

View ArSession::on_frame(const Frame& frame, const SourceStatus& source) {
  if (frame.still || source_of(frame) != state_.source) augment_ = {};
  frame_ = frame;
  source_ = source.state == SourceState::kLive ? "" : std::string(tarsier::name_of(source.state));
  find();
  draw();
  return view(true);
}

View ArSession::on_idle(const SourceStatus& source) {
  source_ = source.state == SourceState::kLive ? "" : std::string(tarsier::name_of(source.state));
  return view(false);
}

View ArSession::on_event(const Event& event) {
  const std::string name = action_of(event, actions());
  const auto objects = planar::augment::object_named(name);
  bool redraw = true;
  if (objects && (*objects != Object::kMesh || options_.augment.mesh != nullptr)) {
    options_.augment.object = *objects;
  } else if (name == "outlines") {
    options_.outlines = !options_.outlines;
  } else if (name == "shadow") {
    options_.augment.shadow = !options_.augment.shadow;
  } else if (name == "smooth") {
    planar::MarkerTrackerOptions options = tracker_.options();
    options.track.smooth = !options.track.smooth;
    change(options, false);
  } else if (name == "list") {
    list_ = !list_;
  } else if (name == "family") {
    next_family();
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

void ArSession::change(const planar::MarkerTrackerOptions& options, bool again) {
  tracker_ = planar::MarkerTracker::load(options);
  if (!again) return;
  state_ = {};
  augment_ = {};
  if (!frame_.image.empty()) find();
}

void ArSession::next_family() {
  const auto& names = common_families();
  const auto at = std::find(names.begin(), names.end(), tracker_.families().front()->name());
  planar::MarkerTrackerOptions options = tracker_.options();
  options.families = {at == names.end() || std::next(at) == names.end() ? names.front()
                                                                        : *std::next(at)};
  change(options, true);
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
  for (const TrackedMarker& posed : result_.markers) {
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
  for (const TrackedMarker& posed : result_.markers) {
    if (!posed.pose) continue;
    const int copy = seen[posed.marker.id]++;
    sheets.push_back(
        {posed.marker.id + 100000 * copy, posed.pose->camera_from_marker, tracker_.options().side});
  }
  // Under the objects, which would be hard to see behind the letters.
  if (options_.outlines) draw_outlines();
  planar::augment::augment(output_, result_.camera, sheets, options_.augment, augment_);
}

void ArSession::draw_list() {
  std::string text;
  int listed = 0;
  for (const TrackedMarker& posed : result_.markers) {
    if (++listed > kMaxListed) {
      text += fmt::format("and {} more", result_.markers.size() - kMaxListed);
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
  std::string family;
  for (const auto* one : tracker_.families()) family += (family.empty() ? "" : ", ") + one->name();
  nlohmann::json ids = nlohmann::json::array();
  nlohmann::json distances = nlohmann::json::array();
  for (const TrackedMarker& posed : result_.markers) {
    ids.push_back(posed.marker.id);
    distances.push_back(posed.pose ? nlohmann::json(rounded(distance_of(posed), 1e4)) : nullptr);
  }
  result.state = {{"markers", result_.markers.size()},
                  {"ids", std::move(ids)},
                  {"distance_m", std::move(distances)},
                  {"draw", planar::augment::name_of(options_.augment.object)},
                  {"outlines", options_.outlines},
                  {"shadow", options_.augment.shadow},
                  {"smooth", tracker_.options().track.smooth},
                  {"list", list_},
                  {"family", family},
                  {"paused", paused_}};
  if (!saved_.empty()) result.state["saved"] = saved_;
  const bool speaks = !message_.empty() && frame_.time - message_since_ < kMessage_s;
  result.status = fmt::format("{} {} of {}{}{}", result_.markers.size(),
                              result_.markers.size() == 1 ? "marker" : "markers", family,
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

}  // namespace tarsier
