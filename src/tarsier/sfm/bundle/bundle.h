// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/sfm/scene/model.h"

#include <Eigen/Core>

#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

struct BundleOptions {
  bool focal = false;       // refine fx and fy, with a fixed ratio
  bool center = false;      // refine cx, cy
  bool distortion = false;  // refine k1, k2, p1, p2
  // scale of Cauchy's loss, which reduces the weight of larger residuals; 0: squared loss
  double loss_px = 0.5;
  int max_iterations = 50;
  double tolerance = 1e-6;  // stops when a step reduces the cost by less than this share
  // Images that move; all others that see their points are fixed. Empty: all move.
  std::vector<int> images;
  // The points that some of `images` show, ascending. Empty: computed from the model.
  std::vector<int> points;
  bool only_points = false;  // no image moves; `points` lists the points that do
  // Images that never move and cameras that are never refined, regardless of the other options.
  // With fixed images and empty `images`, all points move, also those that no moving image shows.
  std::vector<int> fixed_images;
  std::vector<int> fixed_cameras;
  // Max observations of a point that are used, see choose_observations(); 0: all. Work and memory
  // grow with its square.
  int max_observations = 0;

  [[nodiscard]] OptionFields fields() {
    return {{"loss_px", loss_px, at_least(0)},
            {"max_iterations", max_iterations, at_least(0)},
            {"tolerance", tolerance, range(0, 1)},
            {"max_observations", max_observations, at_least(0)}};
  }
  void check() const { check_fields(*this); }
};

struct BundleReport {
  int residuals = 0;  // number of observations
  int iterations = 0;
  // Warning, or "". Without a solution the model is unchanged. Where the lens became invalid (see
  // below), the rest is adjusted with the previous lens.
  std::string warning;
};

// Range of focal lengths that an adjustment may produce, as shares of the image's longer side. A
// focal length that starts outside must not move further away.
constexpr double kMinFocalShare = 0.1;
constexpr double kMaxFocalShare = 20;

// Bundle adjustment (Triggs et al., 2000). Minimises the sum of the robust squared reprojection
// errors over poses, points and, if requested, cameras, by bundle_solver.h. The first image is
// fixed, and its distance to the farthest image fixes the scale. A lens that becomes invalid (not
// finite, or a focal length outside the range above) keeps its previous values. Throws Interrupted:
// the model is then unchanged.
BundleReport adjust(Model& model, const BundleOptions& options, const std::stop_token& stop = {});

// Adjusts one image's pose only, with fixed points; `seen`: pairs of pixel and point.
struct Correspondence2D3D {
  cv::Point2d pixel;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
};
void adjust_pose(geometry::Rigid3& pose, const geometry::Camera& camera,
                 const std::vector<Correspondence2D3D>& seen, double loss_px);

}  // namespace tarsier::sfm
