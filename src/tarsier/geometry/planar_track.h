// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/planar_pose.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <optional>
#include <span>
#include <vector>

// The pose of a planar object over a video: which of its two poses is the true one, and steady.
namespace tarsier::geometry {

struct PlanarTrackOptions {
  // Standard deviation that a pixel is trusted to, px; or the share of the object's size in the
  // image if that is more (a camera that is not exactly known errs in proportion).
  double noise_px = 0.3;
  double noise_share = 0.003;
  double switch_evidence = 8;  // in which natural logarithm of odds the other pose must lead
  double max_evidence = 40;    // odds are not remembered beyond, so that errors can be mended
  double gap_s = 0.5;          // unseen for longer, it starts again
  bool smooth = true;          // false: `steady` is the measured pose
  double cutoff_hz = 0.5;      // of the low pass when still
  double still_px_s = 5;       // px/s that noise alone gives
  double beta = 0.3;           // by which the cut-off grows, Hz for each px/s beyond
  double speed_cutoff_hz = 3;  // of that speed itself
  double leash_px = 0.6;       // no pixel of the steady pose is farther from its place

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

// What is remembered between frames.
struct PlanarTrackState {
  bool is_started = false;
  double time = 0;                       // s
  Rigid3 kept;                           // the last pose, as measured
  std::optional<Eigen::Matrix3d> other;  // the other pose's rotation
  double evidence = 0;                   // logarithm of the odds for `kept`, against the other
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();  // from the last frame to this one
  Rigid3 steady;
  std::vector<cv::Point2d> pixels;
  std::vector<cv::Point2d> speed;  // px/s, low-passed
};

struct TrackedPlane {
  PlanarPose pose;                  // as measured
  std::optional<PlanarPose> other;  // the one that was not chosen
  Rigid3 steady;                    // smoothed; the measured pose where that was not asked for
  bool is_new = false;              // no frame before this one
  bool is_switched = false;  // the other pose of the last frames turned out to be the true one
};

// One frame. Both poses (planar_poses) are followed: each belongs to the nearer of those of the
// last frame, turned on as before; the squared errors of the two in px over twice the noise squared
// are summed over the frames as odds, and the pose is changed only against clear odds. So a still
// object near frontal, whose poses explain single images alike, does not flip; and a wrong choice
// at the start is corrected as soon as the images tell. Smoothing is a one-euro filter (Casiez et
// al., CHI 2012) on rotation and translation alike, whose speed is that of the pixels: what moves
// depth and tilt of a small object moves its pixels little, so that their noise is smoothed as
// noise; and the leash bounds the lag. Empty where there is no pose; the state is then as it was.
// `time` (s) rises; otherwise, after a gap, or for another number of points it starts again.
[[nodiscard]] std::optional<TrackedPlane> track_plane(std::span<const cv::Point2d> on_plane,
                                                      std::span<const cv::Point2d> pixels,
                                                      const Camera& camera, double time,
                                                      const PlanarTrackOptions& options,
                                                      PlanarTrackState& state);

}  // namespace tarsier::geometry
