// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/planar_pose.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <optional>
#include <span>
#include <vector>

// Tracks the pose of a planar object in a video: chooses between its two poses and smooths the
// result.
namespace tarsier::geometry {

struct PlanarTrackOptions {
  // Standard deviation of a pixel, px, or this share of the object's size in the image if that is
  // more. The share covers errors of the camera, which grow with the size.
  double noise_px = 0.3;
  double noise_share = 0.003;
  double switch_evidence = 8;  // lead of the other pose, in log odds, that causes a switch
  // Limit of the accumulated log odds, so that an error can be corrected.
  double max_evidence = 40;
  double gap_s = 0.5;          // restarts if the object was not seen for longer
  bool smooth = true;          // false: `steady` is the measured pose
  double cutoff_hz = 0.5;      // of the low-pass filter when still
  double still_px_s = 5;       // px/s caused by noise alone
  double beta = 0.3;           // increase of the cut-off, Hz per px/s beyond still_px_s
  double speed_cutoff_hz = 3;  // cut-off of the low-pass filter of the speed
  // Maximum distance of a pixel of the steady pose from its observation.
  double leash_px = 0.6;

  [[nodiscard]] OptionFields fields() {
    return {{"noise_px", noise_px, above(0)},
            {"noise_share", noise_share, at_least(0)},
            {"switch_evidence", switch_evidence, at_least(0)},
            {"max_evidence", max_evidence, above(0)},
            {"gap_s", gap_s, above(0)},
            {"cutoff_hz", cutoff_hz, above(0)},
            {"still_px_s", still_px_s, at_least(0)},
            {"beta", beta, at_least(0)},
            {"speed_cutoff_hz", speed_cutoff_hz, above(0)},
            {"leash_px", leash_px, above(0)}};
  }
  void check() const { check_fields(*this); }
};

// State between frames.
struct PlanarTrackState {
  bool is_started = false;
  double time = 0;                       // s
  Rigid3 measured;                       // the last measured pose
  std::optional<Eigen::Matrix3d> other;  // rotation of the other pose
  double evidence = 0;                   // log odds of `measured` against the other pose
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();  // rotation from the last frame to this one
  Rigid3 steady;
  std::vector<cv::Point2d> pixels;
  std::vector<cv::Point2d> speed;  // px/s, low-passed
};

struct TrackedPlane {
  PlanarPose pose;                  // as measured
  std::optional<PlanarPose> other;  // the pose that was not chosen
  Rigid3 steady;                    // smoothed pose; the measured pose if smoothing is off
  bool is_new = false;              // first frame
  bool is_switched = false;         // the pose was switched in this frame
};

// Processes one frame.
//
// Both poses (planar_poses) are tracked. Each is assigned to the nearer pose of the last frame,
// predicted with the last rotation. The difference of their squared errors in px, over twice the
// noise squared, is accumulated over the frames as log odds. The pose is switched only if the odds
// are clear. A still object near frontal, whose poses have similar errors in each single image,
// therefore does not flip. A wrong initial choice is corrected as soon as the images show it.
//
// Smoothing is a one-euro filter (Casiez et al., CHI 2012) on rotation and translation, driven by
// the speed of the pixels. A change in depth or tilt of a small object hardly moves its pixels, so
// noise in these is smoothed. leash_px limits the lag.
//
// Empty if there is no pose; the state is then unchanged. `time` (s) must increase. If it does not,
// after a gap, or for another number of points, tracking restarts.
[[nodiscard]] std::optional<TrackedPlane> track_plane(std::span<const cv::Point2d> on_plane,
                                                      std::span<const cv::Point2d> pixels,
                                                      const Camera& camera, double time,
                                                      const PlanarTrackOptions& options,
                                                      PlanarTrackState& state);

}  // namespace tarsier::geometry
