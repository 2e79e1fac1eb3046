// SPDX-License-Identifier: MIT
#include "tarsier/geometry/planar_track.h"

#include "tarsier/geometry/rigid3.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace tarsier::geometry {
namespace {

// Maximum contribution of one frame to the log odds: a single bad image proves little.
constexpr double kMaxFrameEvidence = 3;
// Poses with a smaller rotation between them count as equal.
constexpr double kMinPoseDifference_rad = 2 * CV_PI / 180;

double angle_between(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b) {
  return angle_of(a * b.transpose());
}

double low_pass_weight(double cutoff_hz, double seconds) {
  const double r = 2 * CV_PI * cutoff_hz * seconds;
  return r / (1 + r);
}

double extent_of(std::span<const cv::Point2d> pixels) {
  cv::Point2d low = pixels[0];
  cv::Point2d high = pixels[0];
  for (const cv::Point2d& p : pixels) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y)};
  }
  return std::max(high.x - low.x, high.y - low.y);
}

// Log odds of the first pose, from the pixels.
double evidence_of(const PlanarPose& first, const PlanarPose& second, std::size_t points,
                   double noise) {
  const double difference = second.rms_px * second.rms_px - first.rms_px * first.rms_px;
  return std::clamp(static_cast<double>(points) * difference / (2 * noise * noise),
                    -kMaxFrameEvidence, kMaxFrameEvidence);
}

double max_error_px(const Rigid3& pose, std::span<const cv::Point2d> on_plane,
                    std::span<const cv::Point2d> pixels, const Camera& camera) {
  double farthest = 0;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const auto at = camera.project(pose * Eigen::Vector3d(on_plane[i].x, on_plane[i].y, 0));
    if (!at) return std::numeric_limits<double>::infinity();
    farthest = std::max(farthest, cv::norm(*at - pixels[i]));
  }
  return farthest;
}

Rigid3 between(const Rigid3& a, const Rigid3& b, double part) {
  return {interpolate(a.rotation, b.rotation, part),
          a.translation + part * (b.translation - a.translation)};
}

// `first` continues the last measured pose.
struct Choice {
  PlanarPose first;
  std::optional<PlanarPose> second;
};

// Assigns each pose to the nearer of the two poses of the last frame.
Choice assigned(const PlanarPoses& poses, const PlanarTrackState& state) {
  Choice choice{poses.best, poses.other};
  if (!poses.other) return choice;
  // Predicts the rotation slightly smaller than the last one, because a part of that is noise.
  const Eigen::Matrix3d predicted_turn = interpolate(Eigen::Matrix3d::Identity(), state.turn, 0.7);
  const Eigen::Matrix3d predicted = predicted_turn * state.measured.rotation;
  const double best = angle_between(poses.best.camera_from_plane.rotation, predicted);
  const double other = angle_between(poses.other->camera_from_plane.rotation, predicted);
  if (other < best) std::swap(choice.first, *choice.second);
  return choice;
}

void smooth(std::span<const cv::Point2d> on_plane, std::span<const cv::Point2d> pixels,
            const Camera& camera, double seconds, const PlanarTrackOptions& options,
            const Rigid3& measured, PlanarTrackState& state) {
  const double speed_weight = low_pass_weight(options.speed_cutoff_hz, seconds);
  double fastest = 0;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const cv::Point2d now = (pixels[i] - state.pixels[i]) * (1 / seconds);
    state.speed[i] += speed_weight * (now - state.speed[i]);
    fastest = std::max(fastest, cv::norm(state.speed[i]));
  }
  const double part = low_pass_weight(
      options.cutoff_hz + options.beta * std::max(0.0, fastest - options.still_px_s), seconds);
  state.steady = between(state.steady, measured, part);
  // Half-way in pose is nearly half-way in pixels, so two iterations satisfy the limit.
  for (int i = 0; i < 2; ++i) {
    const double error = max_error_px(state.steady, on_plane, pixels, camera);
    if (error <= options.leash_px) break;
    // The measured pose has its own distance, which the limit cannot reduce.
    const double measured_error = max_error_px(measured, on_plane, pixels, camera);
    const double allowance = std::max(options.leash_px - measured_error, 0.1 * options.leash_px);
    const double part_to_measured = std::isfinite(error) ? 1 - std::min(1.0, allowance / error) : 1;
    state.steady = between(state.steady, measured, part_to_measured);
  }
}

}  // namespace

std::optional<TrackedPlane> track_plane(std::span<const cv::Point2d> on_plane,
                                        std::span<const cv::Point2d> pixels, const Camera& camera,
                                        double time, const PlanarTrackOptions& options,
                                        PlanarTrackState& state) {
  options.check();
  const auto poses = planar_poses(on_plane, pixels, camera);
  if (!poses) return std::nullopt;
  const double seconds = time - state.time;
  TrackedPlane tracked;
  tracked.is_new = !state.is_started || !(seconds > 0) || seconds > options.gap_s ||
                   state.pixels.size() != pixels.size();
  const double noise = std::max(options.noise_px, options.noise_share * extent_of(pixels));
  Choice choice{poses->best, poses->other};
  if (tracked.is_new) {
    state = {};
    if (choice.second)
      state.evidence = evidence_of(choice.first, *choice.second, pixels.size(), noise);
  } else {
    choice = assigned(*poses, state);
    if (choice.second) {
      state.evidence = std::clamp(
          state.evidence + evidence_of(choice.first, *choice.second, pixels.size(), noise),
          -options.max_evidence, options.max_evidence);
      // Where the two poses meet they are indistinguishable, so the odds restart.
      if (angle_between(choice.first.camera_from_plane.rotation,
                        choice.second->camera_from_plane.rotation) < kMinPoseDifference_rad)
        state.evidence = 0;
      if (state.evidence < -options.switch_evidence) {
        std::swap(choice.first, *choice.second);
        state.evidence = -state.evidence;
        tracked.is_switched = true;
      }
    } else {
      state.evidence = 0;
    }
    // Rotations are noisy near frontal: half of each is new.
    const Eigen::Matrix3d turn =
        choice.first.camera_from_plane.rotation * state.measured.rotation.transpose();
    state.turn =
        tracked.is_switched ? Eigen::Matrix3d::Identity() : interpolate(state.turn, turn, 0.5);
  }
  tracked.pose = choice.first;
  tracked.other = choice.second;
  const Rigid3& measured = tracked.pose.camera_from_plane;
  if (tracked.is_new || tracked.is_switched || !options.smooth) {
    state.steady = measured;
    state.speed.assign(pixels.size(), {});
  } else {
    smooth(on_plane, pixels, camera, seconds, options, measured, state);
  }
  state.is_started = true;
  state.time = time;
  state.measured = measured;
  state.other.reset();
  if (choice.second) state.other = choice.second->camera_from_plane.rotation;
  state.pixels.assign(pixels.begin(), pixels.end());
  tracked.steady = state.steady;
  return tracked;
}

}  // namespace tarsier::geometry
