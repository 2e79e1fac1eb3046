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

// Trains the 3D head model from 2D landmarks of many faces in many poses, by non-rigid structure
// from motion. Each face is one image of one shape, x_i = t + s [R (mean_i + modes_i b)]_xy / d_i
// with d_i = 1 + [R (mean_i + modes_i b)]_z / distance.
//
// Initialisation: the rigid factorisation of Tomasi and Kanade (IJCV 1992) with a symmetric head.
// The part that is odd under mirroring has rank 1 (x), the even part has rank 2 (y, z). Only four
// numbers then remain to make the rows of all cameras orthogonal and of equal length.
//
// Then expectation maximisation with Gaussian modes (Torresani, Hertzmann and Bregler, PAMI 2008).
// The mean and each mode are symmetric; each pair of points has its own noise; residuals have
// robust weights. Points of the outline have additional weights: in a turned face, the outline of
// the far side is not a fixed point of the head. The head's axes are those of the median face
// (pitch 0), which is assumed to look straight into the camera.
namespace tarsier::face::head {

struct TrainHeadOptions {
  int modes = 12;
  int iterations = 100;  // of expectation maximisation
  // Between the outer eye corners, mm: sets the scale, which images cannot determine.
  double outer_eye_mm = 89;
  // Typical distance from the camera to the head, mm: sets the strength of perspective, which
  // images of single faces cannot determine.
  double distance_mm = 1500;
  // Points of the outline, whose far side is ignored in turned faces. Default if empty and there
  // are 68 points: 0..16.
  std::vector<int> outline;
  double outline_yaw_deg = 10;  // their weight is exp(-(yaw / this)^2 / 2)
  double robust_sigmas = 3;     // larger residuals get less weight (Geman-McClure)
  std::uint64_t seed = 1;       // of the initial modes

  [[nodiscard]] OptionFields fields() {
    return {{"modes", modes, range(0, 40), "--modes", "number of deformation modes"},
            {"iterations", iterations, range(1, 10000), "--iterations",
             "number of iterations of expectation maximisation"},
            {"outer_eye_mm", outer_eye_mm, range(10, 1000), "--outer-eye-mm",
             "distance of the outer eye corners, mm; sets the scale"},
            {"distance_mm", distance_mm, at_least(300), "--distance-mm",
             "typical distance from camera to head, mm"},
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

// faces: 2 x n each, px; faces with NaN are skipped (their angles are 0). Throws
// std::invalid_argument: fewer than 10 complete faces, different numbers of points, a mirror that
// is not an involution, faces without rotation (depth cannot be determined); Interrupted.
[[nodiscard]] TrainedHead train_head(const std::vector<Eigen::Matrix2Xd>& faces,
                                     const shape::Markup& markup,
                                     const TrainHeadOptions& options = {},
                                     Progress* progress = nullptr,
                                     const std::stop_token& stop = {});

// Mean distance between the given points of two shapes (3 x n) after the least-squares similarity
// from the first to the second (Umeyama 1991), in units of the second. The alignment uses all
// points. `points` empty: all.
[[nodiscard]] double aligned_error(const Eigen::Matrix3Xd& shape, const Eigen::Matrix3Xd& truth,
                                   const std::vector<int>& points = {});

}  // namespace tarsier::face::head
