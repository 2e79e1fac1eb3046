// SPDX-License-Identifier: MIT
#include "tarsier/synth/sfm_scene_paths.h"

#include "tarsier/core/angles.h"
#include "tarsier/synth/route.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace tarsier::synth {
namespace {

constexpr double kStepDeg = 7;
constexpr double kSpanDeg = 60;
constexpr double kLineStep = 0.9;
constexpr double kLineSpan = 12;
constexpr double kGridAcross = 2.4;  // units between images of a row
constexpr double kGridDown = 2;      // units between rows
constexpr double kAround = 4;        // units of a street that smooth its corners
constexpr double kTurnLength = 6;    // units of path that count as much as one radian of rotation

// A camera at `center`, with `up` at the top of its image except for `roll` degrees.
geometry::Rigid3 look_along(const Eigen::Vector3d& center, const Eigen::Vector3d& direction,
                            const Eigen::Vector3d& up, double roll) {
  const Eigen::Vector3d forward = direction.normalized();
  const Eigen::Vector3d level = forward.cross(up).normalized();
  const Eigen::Vector3d plumb = forward.cross(level);
  const Eigen::Vector3d right =
      std::cos(roll * kRadiansPerDegree) * level + std::sin(roll * kRadiansPerDegree) * plumb;
  const Eigen::Vector3d down = forward.cross(right);
  Eigen::Matrix3d rotation;
  rotation << right.transpose(), down.transpose(), forward.transpose();
  return {rotation, -(rotation * center)};
}

// Evenly spaced positions about 0, with steps of `step` but a total of at most `span`.
double spread(int index, int count, double step, double span) {
  const double stride = count > 1 ? std::min(step, span / (count - 1)) : step;
  return (index - (count - 1) / 2.0) * stride;
}

// Row by row, alternately there and back.
Eigen::Vector3d over_grid(int index, int count) {
  const int across = std::max(1, static_cast<int>(std::lround(std::sqrt(count))));
  const int down = (count + across - 1) / across;
  const int row = index / across;
  const int column = row % 2 == 0 ? index % across : across - 1 - index % across;
  return {(column - (across - 1) / 2.0) * kGridAcross, (row - (down - 1) / 2.0) * kGridDown,
          kCameraDistance};
}

}  // namespace

// Hand-held: each camera deviates slightly from its position and direction.
geometry::Rigid3 make_pose(Trajectory trajectory, bool pure_rotation, double ring_deg, int index,
                           int count, const Rng& base) {
  Rng rng = base.fork(static_cast<std::uint64_t>(index));
  const Eigen::Vector3d y_up{0, 1, 0};
  const Eigen::Vector3d shake{rng.uniform(-0.08, 0.08), rng.uniform(-0.35, 0.35),
                              rng.uniform(-0.15, 0.15)};
  const Eigen::Vector3d aim{rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), 0};
  const double roll = rng.uniform(-2, 2);
  if (pure_rotation) {
    const double yaw = spread(index, count, kStepDeg, kSpanDeg) * kRadiansPerDegree;
    const double pitch = rng.uniform(-5, 5) * kRadiansPerDegree;
    return look_along(
        {0, 0, kCameraDistance},
        {std::sin(yaw) * std::cos(pitch), std::sin(pitch), -std::cos(yaw) * std::cos(pitch)}, y_up,
        roll);
  }
  switch (trajectory) {
    case Trajectory::kArc: {
      const double angle = spread(index, count, kStepDeg, kSpanDeg) * kRadiansPerDegree;
      const Eigen::Vector3d center =
          kSceneCenter + kCameraDistance * Eigen::Vector3d(std::sin(angle), 0, std::cos(angle)) +
          shake;
      return look_along(center, kSceneCenter + aim - center, y_up, roll);
    }
    case Trajectory::kRing: {
      const double angle = 360.0 * index / count * kRadiansPerDegree;
      const double rise = (ring_deg + rng.uniform(-2, 2)) * kRadiansPerDegree;
      const Eigen::Vector3d center =
          kSceneCenter + kCameraDistance * Eigen::Vector3d(std::cos(rise) * std::cos(angle),
                                                           std::cos(rise) * std::sin(angle),
                                                           std::sin(rise));
      return look_along(center, kSceneCenter + aim - center, {0, 0, 1}, roll);
    }
    case Trajectory::kGrid:
      return look_along(over_grid(index, count) + shake,
                        Eigen::Vector3d(0, 0, -kCameraDistance) + 2 * aim, y_up, roll);
    default:
      break;
  }
  const Eigen::Vector3d center{spread(index, count, kLineStep, kLineSpan), 0, kCameraDistance};
  return look_along(center + shake, Eigen::Vector3d(0, 0, -kCameraDistance) + aim, y_up, roll);
}

std::vector<geometry::Rigid3> poses_along(std::span<const Eigen::Vector2d> line, int count,
                                          const Rng& base) {
  const Route route(line, kAround, kAround);
  std::vector<geometry::Rigid3> poses;
  for (const double s : route.positions(count, kTurnLength)) {
    const Eigen::Vector2d at = route.at(s);
    const Eigen::Vector2d ahead = route.ahead(s);
    const Eigen::Vector2d left(-ahead.y(), ahead.x());
    const Eigen::Vector2d view = ahead + 1.2 * left;
    Rng rng = base.fork(static_cast<std::uint64_t>(poses.size()));
    const Eigen::Vector3d center{at.x() + rng.uniform(-0.15, 0.15),
                                 at.y() + rng.uniform(-0.15, 0.15), rng.uniform(1.8, 2.6)};
    const Eigen::Vector3d aim{view.x() + rng.uniform(-0.06, 0.06),
                              view.y() + rng.uniform(-0.06, 0.06), rng.uniform(0.2, 0.3)};
    poses.push_back(look_along(center, aim, {0, 0, 1}, rng.uniform(-2, 2)));
  }
  return poses;
}

}  // namespace tarsier::synth
