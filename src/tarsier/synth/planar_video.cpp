// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/synth/full_turn.h"
#include "tarsier/synth/planar_images.h"
#include "tarsier/synth/planar_worlds.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tarsier::synth {
namespace {

constexpr double kRound_s = 6;     // motion and rest together
constexpr double kMotion_s = 4.5;  // motion in each round
constexpr double kPass_s = 9;      // between two passes of the hand
constexpr double kPassing_s = 2.5;

geometry::Camera video_camera(const VideoOptions& options) {
  options.check();
  geometry::Camera camera;
  camera.width = options.size.width;
  camera.height = options.size.height;
  camera.fx = camera.fy = 0.95 * std::max(options.size.width, options.size.height);
  camera.cx = 0.5 * (options.size.width - 1);
  camera.cy = 0.5 * (options.size.height - 1);
  if (options.distorted) camera.distortion = {-0.25, 0.08, 5e-4, -5e-4, 0};
  return camera;
}

std::vector<PlanarPrint> add_occluder(std::vector<PlanarPrint> prints,
                                      const VideoOptions& options) {
  if (!options.with_occluder || prints.empty()) return prints;
  prints.push_back(occluder_print(true, 1.5 * prints.front().width, options.seed));
  return prints;
}

// From 0 to kMotion_s / 1.5 in each round, never faster than the video's own time.
double path_time(double time_s) {
  const double round = std::floor(time_s / kRound_s);
  const double share = std::min(1.0, (time_s - round * kRound_s) / kMotion_s);
  return kMotion_s / 1.5 * (round + share * share * (3 - 2 * share));
}

}  // namespace

void VideoOptions::check() const {
  check_fields(*this);
  imaging.check();
}

PlanarVideo::PlanarVideo(std::vector<PlanarPrint> prints,
                         std::vector<geometry::Rigid3> world_from_print, double radius,
                         const VideoOptions& options)
    : options_(options),
      radius_(radius),
      world_from_print_(std::move(world_from_print)),
      scene_(video_camera(options), add_occluder(std::move(prints), options),
             clutter_image(1024, options.seed), 8 * radius) {
  TARSIER_REQUIRE(radius > 0, "radius {}", radius);
  const std::size_t occluders = options.with_occluder && !world_from_print_.empty() ? 1 : 0;
  TARSIER_REQUIRE(world_from_print_.size() + occluders == scene_.prints().size(),
                  "{} poses for {} prints", world_from_print_.size(),
                  scene_.prints().size() - occluders);
  set_rate();
}

bool PlanarVideo::is_at_rest(double time_s) {
  return time_s - std::floor(time_s / kRound_s) * kRound_s >= kMotion_s;
}

// The camera looks at a moving point, from a direction that tilts and rotates.
geometry::Rigid3 PlanarVideo::camera_at(double path) const {
  Rng rng(options_.seed ^ 0xf117ULL);
  const auto swing = [&](double period_s) {
    const double phase = rng.uniform();
    const double own = period_s * rng.uniform(0.85, 1.15);
    return std::sin(kTurn * (path / own + phase));
  };
  const double tilt = options_.tilt_deg * CV_PI / 180 * (0.5 + 0.5 * swing(7));
  // On the near side of the desk, like a sitting person, so that objects on it are upright in the
  // image.
  const double azimuth = -0.25 * kTurn + 0.9 * swing(11) + 0.5 * swing(23);
  const double roll = 0.5 * swing(9);
  const double smaller = std::min(options_.size.width, options_.size.height);
  const double distance = 2.2 * radius_ * scene_.camera().fx / smaller * (1.15 + 0.3 * swing(13));
  const double aside = 0.2 * radius_ * swing(5);
  const Eigen::Vector3d target(aside, 0.2 * radius_ * swing(6), 0);
  const Eigen::Vector3d back(std::sin(tilt) * std::cos(azimuth), std::sin(tilt) * std::sin(azimuth),
                             std::cos(tilt));  // from the target to the camera
  const Eigen::Vector3d forward = -back;
  // "Up" is along the desk's y axis, rotated by `roll`.
  const Eigen::Vector3d up(-std::sin(roll), std::cos(roll), 0);
  const Eigen::Vector3d right = forward.cross(up).normalized();
  const Eigen::Vector3d down = forward.cross(right);
  geometry::Rigid3 pose;
  pose.rotation << right.transpose(), down.transpose(), forward.transpose();
  pose.translation = -(pose.rotation * (target + distance * back));
  return pose;
}

double PlanarVideo::motion_px(const PlanarShot& from, const PlanarShot& to) const {
  double max_motion = 0;
  for (std::size_t i = 0; i < world_from_print_.size(); ++i) {
    const double half = 0.5 * scene_.prints()[i].width;
    for (int k = 0; k < 4; ++k) {
      const Eigen::Vector3d corner =
          world_from_print_[i] *
          Eigen::Vector3d(k % 2 == 0 ? -half : half, k < 2 ? -half : half, 0);
      const auto a = camera().project(from.camera_from_world * corner);
      const auto b = camera().project(to.camera_from_world * corner);
      if (a && b) max_motion = std::max(max_motion, cv::norm(*a - *b));
    }
  }
  return max_motion;
}

// Sets the rate so that the fastest frame of the first minutes has the requested speed.
void PlanarVideo::set_rate() {
  constexpr double kStep_s = 0.04;
  double max_motion = 0;
  for (int k = 0; k < 3000; ++k) {
    const PlanarShot a{camera_at(k * kStep_s), {}};
    const PlanarShot b{camera_at((k + 1) * kStep_s), {}};
    max_motion = std::max(max_motion, motion_px(a, b));
  }
  if (max_motion > 0) rate_ = options_.speed_px / max_motion * kStep_s * options_.fps;
}

PlanarShot PlanarVideo::shot_at(double time_s) const {
  PlanarShot shot;
  shot.camera_from_world = camera_at(rate_ * path_time(std::max(0.0, time_s)));
  shot.world_from_print = world_from_print_;
  if (!options_.with_occluder || world_from_print_.empty()) return shot;
  // Enters from the left, passes over one print, and returns.
  const double pass = std::floor(time_s / kPass_s);
  const double since = time_s - pass * kPass_s - (kPass_s - kPassing_s);
  const double share = since > 0 ? std::sin(CV_PI * since / kPassing_s) : 0;
  const auto which = static_cast<std::size_t>(std::max(0.0, pass)) % world_from_print_.size();
  const Eigen::Vector3d over = world_from_print_[which].translation;
  const double size = scene_.prints().front().width;
  geometry::Rigid3 hand;
  // Its fingers, which point up in its image, point to the print.
  hand.rotation << 0, 1, 0, -1, 0, 0, 0, 0, 1;
  if (since <= 0) hand.rotation << 0, 1, 0, 1, 0, 0, 0, 0, -1;  // its back: not drawn
  hand.translation =
      over + Eigen::Vector3d(-5 * radius_ * (1 - share) - 0.6 * size, 0, 0.35 * size);
  shot.world_from_print.push_back(hand);
  return shot;
}

cv::Mat PlanarVideo::image_at(double time_s) const {
  ImagingConditions imaging = options_.imaging;
  imaging.gain *= 1 + options_.exposure * std::sin(kTurn * time_s / 5);
  imaging.seed += static_cast<std::uint64_t>(std::llround(std::max(0.0, time_s) * 1e4));
  const double open_s = options_.shutter / options_.fps;
  const double smear = motion_px(shot_at(time_s - 0.5 * open_s), shot_at(time_s + 0.5 * open_s));
  const int count = smear < 0.8 ? 1 : std::clamp(cvCeil(smear / 1.5) + 1, 4, 8);
  std::vector<PlanarShot> shots;
  shots.reserve(count);
  for (int k = 0; k < count; ++k)
    shots.push_back(shot_at(time_s + open_s * ((k + 0.5) / count - 0.5)));
  return scene_.render(shots, imaging);
}

std::vector<PrintTruth> PlanarVideo::truth_at(double time_s) const {
  return scene_.truth(shot_at(time_s));
}

PlanarVideo marker_video(const planar::markers::Dictionary& family, int count, double side,
                         const VideoOptions& options) {
  TARSIER_REQUIRE(count >= 1 && count <= 12 && count <= family.size(), "{} markers", count);
  std::vector<PlanarPrint> prints;
  std::vector<geometry::Rigid3> poses;
  Rng rng(options.seed ^ 0xde5cULL);
  const int columns = cvCeil(std::sqrt(count));
  const int rows = (count + columns - 1) / columns;
  for (int i = 0; i < count; ++i) {
    prints.push_back(marker_print(family, i, side));
    const double turn = rng.uniform(-0.6, 0.6);
    // The last of several prints lies on a slope of 30 degrees.
    const double slope = count > 1 && i == count - 1 ? CV_PI / 6 : 0;
    const Eigen::Matrix3d upright = geometry::rotation_by({slope, 0, 0});
    geometry::Rigid3 pose;
    pose.rotation = geometry::rotation_by({0, 0, turn}) * upright;
    pose.translation = {1.9 * side * (i % columns - 0.5 * (columns - 1)),
                        1.9 * side * (0.5 * (rows - 1) - i / columns),
                        0.7 * side * std::sin(slope)};
    poses.push_back(pose);
  }
  return {std::move(prints), std::move(poses), 1.05 * side * std::max(1.3, 1.0 * columns), options};
}

PlanarVideo print_video(std::vector<PlanarPrint> prints, const VideoOptions& options) {
  TARSIER_REQUIRE(!prints.empty(), "no prints");
  std::vector<geometry::Rigid3> poses;
  double width = 0;
  double height = 0;
  for (const PlanarPrint& print : prints) {
    const cv::Rect2d part =
        print.part.empty() ? cv::Rect2d(0, 0, print.image.cols, print.image.rows) : print.part;
    width += 1.15 * print.width;
    height = std::max(height, print.width * part.height / part.width);
  }
  double at = -0.5 * width;
  for (const PlanarPrint& print : prints) {
    poses.push_back({Eigen::Matrix3d::Identity(), {at + 0.575 * print.width, 0, 0}});
    at += 1.15 * print.width;
  }
  return {std::move(prints), std::move(poses), 0.62 * std::max(width, height), options};
}

}  // namespace tarsier::synth
