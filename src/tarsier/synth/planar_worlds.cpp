// SPDX-License-Identifier: MIT
#include "tarsier/synth/planar_worlds.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/synth/full_turn.h"
#include "tarsier/synth/planar_images.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace tarsier::synth {
namespace {

constexpr int kGroundPx = 1280;

Eigen::Matrix3d rotation_about(const Eigen::Vector3d& axis, double angle) {
  return geometry::rotation_by(axis.normalized() * angle);
}

// Rotation of a frontal print: x right, y up, z out of it, in the camera frame.
const Eigen::Matrix3d kFrontal{{1, 0, 0}, {0, -1, 0}, {0, 0, -1}};

geometry::Camera plain_camera(cv::Size size, double focal) {
  geometry::Camera camera;
  camera.width = size.width;
  camera.height = size.height;
  camera.fx = camera.fy = focal;
  camera.cx = 0.5 * (size.width - 1);
  camera.cy = 0.5 * (size.height - 1);
  return camera;
}

ImagingConditions random_imaging(PlanarLevel level, cv::Size size, Rng& rng) {
  const bool easy = level == PlanarLevel::kEasy;
  const bool hard = level == PlanarLevel::kHard;
  ImagingConditions imaging;
  imaging.gain = easy   ? rng.uniform(0.83, 1.1)
                 : hard ? rng.uniform(0.26, 0.87)
                        : rng.uniform(0.5, 0.95);
  imaging.slope = easy   ? rng.uniform(0, 0.19)
                  : hard ? rng.uniform(0.1, 0.92)
                         : rng.uniform(0, 0.57);
  imaging.slope_angle = rng.uniform(0, kTurn);
  imaging.vignette = rng.uniform(0, 0.3);
  imaging.shadow = easy ? 0 : rng.uniform(0, hard ? 0.7 : 0.38);
  imaging.shadow_angle = rng.uniform(0, kTurn);
  imaging.shadow_offset = 0.12 * size.width * rng.uniform(-1, 1);
  imaging.shadow_width = rng.uniform(2, 40);
  imaging.haze = rng.uniform(0.5, 20);
  imaging.defocus_px = rng.uniform(0.05, easy ? 0.55 : hard ? 1.95 : 1.2);
  imaging.noise = easy   ? rng.uniform(0.6, 3)
                  : hard ? rng.uniform(2.3, 14.5)
                         : rng.uniform(0.5, 7.5);
  imaging.seed = rng();
  return imaging;
}

// Small rotations of the camera that blur the image by `px` along `angle`, symmetric about the
// central moment.
std::vector<PlanarShot> smeared(const PlanarShot& shot, double px, double angle, double focal) {
  if (px < 0.4) return {shot};
  const int count = std::clamp(cvCeil(px) + 2, 4, 16);
  const Eigen::Vector3d axis(-std::sin(angle), std::cos(angle), 0);
  std::vector<PlanarShot> shots;
  for (int k = 0; k < count; ++k) {
    const double share = (k + 0.5) / count - 0.5;
    PlanarShot moved = shot;
    const geometry::Rigid3 turn{rotation_about(axis, share * px / focal)};
    moved.camera_from_world = turn * shot.camera_from_world;
    shots.push_back(std::move(moved));
  }
  return shots;
}

bool is_inside(const PrintTruth& truth, cv::Size size, double margin) {
  return std::all_of(truth.corners.begin(), truth.corners.end(), [&](const cv::Point2d& p) {
    return p.x >= margin && p.y >= margin && p.x <= size.width - 1 - margin &&
           p.y <= size.height - 1 - margin;
  });
}

// Places prints in front of the camera one by one, without overlap.
class PrintPlacer {
 public:
  PrintPlacer(const geometry::Camera& camera, const StillOptions& options, Rng& rng)
      : camera_(camera), options_(options), rng_(rng) {}

  // A pose in which the print's part is inside the image and does not overlap others.
  std::optional<geometry::Rigid3> place(const PlanarPrint& print) {
    const cv::Size size(camera_.width, camera_.height);
    const double max_side = std::min(options_.max_side_px, 0.6 * std::min(size.width, size.height));
    for (int attempt = 0; attempt < 60; ++attempt) {
      const double min_side = std::min(options_.min_side_px, max_side);
      const double side = min_side * std::pow(max_side / min_side, rng_.uniform());
      const cv::Point2d at{rng_.uniform(0, size.width), rng_.uniform(0, size.height)};
      const double tilt = options_.tilt_deg * CV_PI / 180 * std::sqrt(rng_.uniform());
      const double around = rng_.uniform(0, kTurn);
      const double roll = rng_.uniform(0, kTurn);
      geometry::Rigid3 pose;
      pose.rotation = rotation_about({std::cos(around), std::sin(around), 0}, tilt) * kFrontal *
                      rotation_about({0, 0, 1}, roll);
      const double depth = camera_.fx * print.width / side;
      pose.translation = {(at.x - camera_.cx) / camera_.fx * depth,
                          (at.y - camera_.cy) / camera_.fy * depth, depth};
      // Leaves a margin around the part.
      const cv::Rect2d part =
          print.part.empty() ? cv::Rect2d(0, 0, print.image.cols, print.image.rows) : print.part;
      const double reach = 0.75 * side * std::max(1.0, part.height / part.width);
      const bool is_free =
          std::none_of(occupied_.begin(), occupied_.end(), [&](const Eigen::Vector3d& t) {
            return std::hypot(t[0] - at.x, t[1] - at.y) < t[2] + reach;
          });
      if (!is_free || !is_fully_visible(print, part, pose, size)) continue;
      occupied_.emplace_back(at.x, at.y, reach);
      return pose;
    }
    return std::nullopt;
  }

 private:
  [[nodiscard]] bool is_fully_visible(const PlanarPrint& print, const cv::Rect2d& part,
                                      const geometry::Rigid3& pose, cv::Size size) const {
    const double x = 0.5 * print.width;
    const double y = x * part.height / part.width;
    for (int k = 0; k < 4; ++k) {
      const auto p =
          camera_.project(pose * Eigen::Vector3d(k == 0 || k == 3 ? -x : x, k < 2 ? y : -y, 0));
      if (!p || p->x < 3 || p->y < 3 || p->x > size.width - 4 || p->y > size.height - 4)
        return false;
    }
    // Seen from the front, at least by one degree.
    const Eigen::Vector3d normal = pose.rotation * Eigen::Vector3d(0, 0, 1);
    return -normal.dot(pose.translation.normalized()) >
           std::cos(std::min(85.0, options_.tilt_deg + 3) * CV_PI / 180);
  }

  const geometry::Camera& camera_;
  const StillOptions& options_;
  Rng& rng_;
  std::vector<Eigen::Vector3d> occupied_;  // x, y, radius, px
};

// A hand or bar that enters from outside over a part of the print, slightly nearer to the camera.
std::pair<PlanarPrint, geometry::Rigid3> occluder_over(const PlanarPrint& print,
                                                       const geometry::Rigid3& camera_from_print,
                                                       Rng& rng) {
  const bool is_hand = rng.uniform() < 0.5;
  const double width = print.width * (is_hand ? rng.uniform(1.0, 1.6) : rng.uniform(0.5, 1.2));
  PlanarPrint occluder = occluder_print(is_hand, width, rng());
  const double angle = rng.uniform(0, kTurn);
  const double offset = print.width * rng.uniform(0.35, 0.75);
  geometry::Rigid3 above;
  above.rotation = rotation_about({0, 0, 1}, rng.uniform(0, kTurn));
  above.translation = {offset * std::cos(angle), offset * std::sin(angle), 0.02 * print.width};
  return {std::move(occluder), camera_from_print * above};
}

PlanarStill still_of(std::vector<PlanarPrint> prints, const std::vector<geometry::Rigid3>& poses,
                     const geometry::Camera& camera, PlanarLevel level, Rng& rng) {
  PlanarStill still;
  still.camera = camera;
  still.level = level;
  const cv::Size size(camera.width, camera.height);
  still.imaging = random_imaging(level, size, rng);
  const bool moves = level != PlanarLevel::kEasy && rng.uniform() < 0.6;
  still.motion_px = moves ? rng.uniform(0, level == PlanarLevel::kHard ? 9 : 4) : 0;
  still.motion_angle = rng.uniform(0, kTurn);
  // The ground, behind all prints: 3 m of it fill the image.
  const double height = 1.5 * camera.fx / std::min(size.width, size.height);
  const double around = rng.uniform(0, kTurn);
  PlanarShot shot;
  shot.camera_from_world.rotation =
      rotation_about({std::cos(around), std::sin(around), 0}, rng.uniform(0, 0.4)) * kFrontal;
  shot.camera_from_world.translation = {rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), height};
  const geometry::Rigid3 world_from_camera = shot.camera_from_world.inverse();
  for (const geometry::Rigid3& pose : poses)
    shot.world_from_print.push_back(world_from_camera * pose);
  const PlanarScene scene(camera, std::move(prints), clutter_image(kGroundPx, rng()), 3.6);
  const auto shots = smeared(shot, still.motion_px, still.motion_angle, camera.fx);
  still.image = scene.render(shots, still.imaging);
  for (PrintTruth& truth : scene.truth(shot))
    if (is_inside(truth, size, 0)) still.truth.push_back(std::move(truth));
  return still;
}

}  // namespace

std::string_view name_of(PlanarLevel level) {
  return level == PlanarLevel::kEasy ? "easy" : level == PlanarLevel::kHard ? "hard" : "medium";
}

void StillOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(min_prints <= max_prints, "{}..{} prints", min_prints, max_prints);
  TARSIER_REQUIRE(max_side_px >= min_side_px, "sides of {}..{} px", min_side_px, max_side_px);
}

PlanarStill marker_still(const planar::markers::Dictionary& family, double side,
                         const StillOptions& options, PlanarLevel level, std::uint64_t seed) {
  options.check();
  Rng rng(seed ^ 0x3a2ce5ULL);
  const geometry::Camera camera =
      plain_camera(options.size, options.size.width * rng.uniform(0.9, 1.2));
  std::vector<PlanarPrint> prints;
  std::vector<geometry::Rigid3> poses;
  PrintPlacer placer(camera, options, rng);
  const int count = rng.integer(options.min_prints, options.max_prints);
  for (int i = 0; i < count; ++i) {
    PlanarPrint print = marker_print(family, rng.integer(0, family.size() - 1), side);
    const auto pose = placer.place(print);
    if (!pose) continue;
    const bool is_hidden = rng.uniform() < options.hidden_share;
    if (is_hidden) {
      auto [occluder, at] = occluder_over(print, *pose, rng);
      prints.push_back(std::move(occluder));
      poses.push_back(at);
    }
    prints.push_back(std::move(print));
    poses.push_back(*pose);
  }
  return still_of(std::move(prints), std::move(poses), camera, level, rng);
}

PlanarStill print_still(const std::vector<PlanarPrint>& prints, const StillOptions& options,
                        PlanarLevel level, std::uint64_t seed) {
  options.check();
  TARSIER_REQUIRE(!prints.empty(), "no prints");
  Rng rng(seed ^ 0x9127e5ULL);
  const geometry::Camera camera =
      plain_camera(options.size, options.size.width * rng.uniform(0.9, 1.2));
  std::vector<PlanarPrint> shown;
  std::vector<geometry::Rigid3> poses;
  PrintPlacer placer(camera, options, rng);
  const PlanarPrint& print =
      prints[static_cast<std::size_t>(rng.integer(0, static_cast<int>(prints.size()) - 1))];
  if (const auto pose = placer.place(print)) {
    if (rng.uniform() < options.hidden_share) {
      auto [occluder, at] = occluder_over(print, *pose, rng);
      shown.push_back(std::move(occluder));
      poses.push_back(at);
    }
    shown.push_back(print);
    poses.push_back(*pose);
  }
  return still_of(std::move(shown), std::move(poses), camera, level, rng);
}

}  // namespace tarsier::synth
