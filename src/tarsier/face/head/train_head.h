// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/head/angles.h"
#include "tarsier/face/head/head_model.h"
#include "tarsier/face/shape/landmark_set.h"

#include <Eigen/Core>

#include <cstdint>
#include <stop_token>
#include <vector>

// The 3D head from 2D landmarks of many faces in many poses, by non-rigid structure from motion:
// each face is one image of one shape, x_i = t + s [R (mean_i + modes_i b)]_xy / d_i with
// d_i = 1 + [R (mean_i + modes_i b)]_z / distance.
//
// Start: the rigid factorisation of Tomasi and Kanade (IJCV 1992) with the head's symmetry built
// in: what is odd under mirroring has rank 1 (x), what is even has rank 2 (y, z), so only four
// numbers are left to make the rows of all cameras orthogonal and of equal length. Then
// expectation maximisation with Gaussian modes (Torresani, Hertzmann and Bregler, PAMI 2008), the
// mean and each mode symmetric; noise of its own for each pair of points; the robust weight of a
// residual; and weights for points of the outline: in a turned face the outline of the far side is
// no fixed point of the head. The head's axes: those of the median face (pitch 0), which is taken
// to look straight into the camera.
namespace tarsier::face::head {

struct TrainHeadOptions {
  int modes = 12;
  int iterations = 100;  // of expectation maximisation
  // Between the outer eye corners, mm: images alone have no scale.
  double outer_eye_mm = 89;
  // Typical distance from the camera to the head, mm. How strong perspective is (images
  // of a single face cannot tell).
  double distance_mm = 1500;
  // Points of the outline, of which the far side does not count in turned faces; for 68 points
  // 0..16 (the default when empty and there are 68 points).
  std::vector<int> outline;
  double outline_yaw_deg = 10;  // their weight is exp(-(yaw / this)^2 / 2)
  double robust_sigmas = 3;     // residuals beyond count less (Geman-McClure)
  std::uint64_t seed = 1;       // of the first modes

  [[nodiscard]] OptionFields fields() {
    return {{"modes", modes, range(0, 40), "--modes", "how many ways to deform are learnt"},
            {"iterations", iterations, range(1, 10000), "--iterations",
             "iterations of expectation maximisation"},
            {"outer_eye_mm", outer_eye_mm, range(10, 1000), "--outer-eye-mm",
             "between the outer eye corners: images alone have no scale"},
            {"distance_mm", distance_mm, at_least(300), "--distance-mm",
             "from the camera to the heads, typically"},
            {"outline_yaw_deg", outline_yaw_deg, above(0)},
            {"robust_sigmas", robust_sigmas, above(0)}};
  }
  void check() const { check_fields(*this); }
};

struct TrainedHead {
  HeadModel model;
  std::vector<HeadAngles> angles;  // of each face, in order
  double rms_mm = 0;               // weighted residual over all faces
};

// faces: 2 x n each, px, without NaN; those with NaN are left out (angles then 0). Throws
// std::invalid_argument: fewer than 10 complete faces, numbers of points that differ, a mirror that
// is no involution, faces that do not turn (no depth can be seen); Interrupted.
[[nodiscard]] TrainedHead train_head(const std::vector<Eigen::Matrix2Xd>& faces,
                                     const shape::Markup& markup,
                                     const TrainHeadOptions& options = {},
                                     Progress* progress = nullptr, std::stop_token stop = {});

// Mean distance of `points` of two shapes (3 x n) after the least-squares similarity that maps the
// first to the second (Umeyama 1991), in units of the second; all points take part in the
// alignment. `points` empty: all.
[[nodiscard]] double aligned_error(const Eigen::Matrix3Xd& shape, const Eigen::Matrix3Xd& truth,
                                   const std::vector<int>& points = {});

}  // namespace tarsier::face::head
