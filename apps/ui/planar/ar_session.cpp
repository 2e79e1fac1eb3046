// SPDX-License-Identifier: MIT
#include "ui/planar/ar_session.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/rounding.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/media/still_source.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "ui/save_image.h"
#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier {
namespace {

using planar::TrackedMarker;
using planar::augment::Object;

const cv::Scalar kOutlineColor(60, 220, 60);
const cv::Scalar kFirstCornerColor(40, 40, 240);
constexpr double kMessage_s = 3;
constexpr int kMaxListed = 12;
constexpr int kBoardKey = -1;  // other keys are ids of markers

// The families that the key cycles through.
const std::vector<std::string>& common_families() {
  static const std::vector<std::string> names{"36h11",    "aruco-original", "4x4_1000", "5x5_1000",
                                              "6x6_1000", "7x7_1000",       "25h9"};
  return names;
}

double distance_of(const planar::markers::MarkerPose& pose) {
  return pose.camera_from_marker.translation.norm();
}

// Angle in degrees between the sheet's normal and the line of sight.
double tilt_of(const planar::markers::MarkerPose& marker) {
  const geometry::Rigid3& pose = marker.camera_from_marker;
  const Eigen::Vector3d normal = pose.rotation * Eigen::Vector3d(0, 0, 1);
  const double cosine = -normal.dot(pose.translation.normalized());
  return std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / CV_PI;
}

}  // namespace

void ArSessionOptions::check() const { augment.check(); }

ArSession::ArSession(planar::MarkerTracker tracker, ArSessionOptions options)
    : FrameSession("Markers"),
      options_((options.check(), std::move(options))),
      tracker_(std::move(tracker)) {}

void ArSession::process(const Frame& frame) {
  if (frame.still || source_of(frame) != state_.source) augment_ = {};
  result_ = tracker_.process(frame, state_, watched(options_.debug));
}

bool ArSession::act(const std::string& name) {
  const auto object = planar::augment::object_named(name);
  if (object && (*object != Object::kMesh || options_.augment.mesh != nullptr)) {
    options_.augment.object = *object;
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
    if (name == "save") save();
    return false;
  }
  return true;
}

std::vector<Action> ArSession::own_actions() const {
  std::vector<Action> actions{{"axes", "draw axes", 'a'},
                              {"cube", "draw a cube", 'c'},
                              {"none", "draw no object", 'n'},
                              {"outlines", "show outlines and ids", 'i'},
                              {"shadow", "shadows on or off", 'e'},
                              {"smooth", "smoothing on or off", 's'},
                              {"list", "list markers with distances", 'l'},
                              {"family", "next marker family", 'f'},
                              {"save", "save the image", 'w'}};
  if (options_.augment.mesh != nullptr)
    actions.insert(actions.begin() + 3, {"mesh", "draw the mesh", 'm'});
  return actions;
}

void ArSession::change(const planar::MarkerTrackerOptions& options, bool resets_state) {
  tracker_ = planar::MarkerTracker::load(options);
  if (!resets_state) return;
  state_ = {};
  if (!frame().empty()) process(latest());
}

void ArSession::next_family() {
  const auto& names = common_families();
  const auto at = std::find(names.begin(), names.end(), tracker_.families().front()->name());
  planar::MarkerTrackerOptions options = tracker_.options();
  options.board.reset();  // it has one family
  options.families = {at == names.end() || std::next(at) == names.end() ? names.front()
                                                                        : *std::next(at)};
  change(options, true);
}

void ArSession::save() {
  if (drawing().empty()) return;
  message_since_ = latest().time;
  try {
    saved_ = save_numbered(options_.save_folder, drawing());
    message_ = "saved " + saved_;
  } catch (const OutputError& error) {  // a live session continues
    log_warning("cannot save: {}", error.what());
    message_ = "cannot save: see the log";
  }
}

void ArSession::draw_outlines(cv::Mat& image) const {
  for (const TrackedMarker& posed : result_.markers) {
    const planar::markers::Quad& quad = posed.marker.corners;
    constexpr int kShift = 4;
    const auto fixed = [](const Eigen::Vector2d& p) {
      return cv::Point(cvRound(p.x() * (1 << kShift)), cvRound(p.y() * (1 << kShift)));
    };
    for (std::size_t k = 0; k < 4; ++k) {
      cv::line(image, fixed(quad[k]), fixed(quad[(k + 1) % 4]), kOutlineColor, 2, cv::LINE_AA,
               kShift);
    }
    const double side = (quad[1] - quad[0]).norm();
    image::draw::point(image, {quad[0].x(), quad[0].y()}, kFirstCornerColor,
                       std::clamp(side * 0.06, 2.0, 6.0));
    const Eigen::Vector2d center = 0.25 * (quad[0] + quad[1] + quad[2] + quad[3]);
    image::draw::TextStyle style;
    style.height_px = std::clamp(side * 0.22, 8.0, 28.0);
    image::draw::put_text(image, std::to_string(posed.marker.id),
                          {cvRound(center.x()), cvRound(center.y())}, style,
                          image::draw::Anchor::kCenter);
  }
}

void ArSession::draw(cv::Mat& image) {
  std::vector<planar::augment::Sheet> sheets;
  if (result_.board) {
    sheets.push_back({kBoardKey, result_.board->camera_from_marker,
                      tracker_.options().board->markers.front().size});
  }
  std::map<int, int> seen;  // count per id: two markers of one id get different keys
  for (const TrackedMarker& posed : result_.markers) {
    if (!posed.pose) continue;
    const int copy = seen[posed.marker.id]++;
    sheets.push_back(
        {posed.marker.id + 100000 * copy, posed.pose->camera_from_marker, tracker_.options().side});
  }
  // Below the objects, because letters over them would hide them.
  if (options_.outlines) draw_outlines(image);
  planar::augment::augment(image, result_.camera, sheets, options_.augment, augment_);
}

void ArSession::draw_shown(cv::Mat& image) {
  if (!list_) return;
  std::string text;
  int listed = 0;
  if (result_.board) {
    text += fmt::format("board: {:.3f} m, {:.0f} deg\n", distance_of(*result_.board),
                        tilt_of(*result_.board));
  }
  for (const TrackedMarker& posed : result_.markers) {
    if (tracker_.options().board) break;  // the markers have no poses of their own
    if (++listed > kMaxListed) {
      text += fmt::format("and {} more", result_.markers.size() - kMaxListed);
      break;
    }
    text += posed.pose ? fmt::format("{}: {:.3f} m, {:.0f} deg\n", posed.marker.id,
                                     distance_of(*posed.pose), tilt_of(*posed.pose))
                       : fmt::format("{}: no pose\n", posed.marker.id);
  }
  if (text.empty()) text = "no markers\n";
  if (text.back() == '\n') text.pop_back();
  image::draw::TextStyle style;
  style.backing = image::draw::Backing::kBox;
  style.height_px = std::max(8.0, 0.7 * image::draw::fitting_text_height(image.size()));
  image::draw::put_text(image, text, {6, 6}, style);
}

std::string ArSession::families() const {
  std::string names;
  for (const auto* one : tracker_.families()) names += (names.empty() ? "" : ", ") + one->name();
  return names;
}

nlohmann::json ArSession::state() const {
  nlohmann::json ids = nlohmann::json::array();
  nlohmann::json distances = nlohmann::json::array();
  for (const TrackedMarker& posed : result_.markers) {
    ids.push_back(posed.marker.id);
    distances.push_back(posed.pose ? nlohmann::json(rounded_to_steps(distance_of(*posed.pose), 1e4))
                                   : nullptr);
  }
  nlohmann::json state = {{"markers", result_.markers.size()},
                          {"ids", std::move(ids)},
                          {"distance_m", std::move(distances)},
                          {"draw", planar::augment::name_of(options_.augment.object)},
                          {"outlines", options_.outlines},
                          {"shadow", options_.augment.shadow},
                          {"smooth", tracker_.options().track.smooth},
                          {"list", list_},
                          {"family", families()}};
  if (tracker_.options().board) {
    state["board_m"] = result_.board
                           ? nlohmann::json(rounded_to_steps(distance_of(*result_.board), 1e4))
                           : nullptr;
  }
  if (!saved_.empty()) state["saved"] = saved_;
  return state;
}

std::string ArSession::status() const {
  return fmt::format("{} of {}", count_text(result_.markers.size(), "marker"), families());
}

std::string ArSession::message() const {
  return latest().time - message_since_ < kMessage_s ? message_ : "";
}

}  // namespace tarsier
