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
  bool focal = false;       // refine fx, fy (their ratio stays)
  bool center = false;      // cx, cy
  bool distortion = false;  // k1, k2, p1, p2
  double loss_px = 0.5;     // Cauchy: residuals well beyond it count little; 0: plain squares
  int max_iterations = 50;
  double tolerance = 1e-6;  // ends when a step takes less than this share off the sum
  // Images that move; all others that see their points stay as they are. Empty: all of them.
  std::vector<int> images;
  // The points that some of `images` show, ascending. Empty: looked for among all of the model's.
  std::vector<int> points;
  bool only_points = false;  // no image moves; `points` says which points do
  // Images that never move, and cameras that are never refined, whatever else is asked for. Where there are such images
  // and `images` is empty, all points move, also those that no image that moves shows.
  std::vector<int> fixed_images;
  std::vector<int> fixed_cameras;
  // Observations of a point that are used, see choose_observations(); 0: all. Work and memory grow with the square of it.
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
  int residuals = 0;  // observations
  int iterations = 0;
  // What went wrong, or "". Where there is no solution the model is as it was; where the lens ran
  // off (below), the rest is adjusted with the lens as it was.
  std::string trouble;
};

// Focal lengths that an adjustment may give: shares of the larger side of the image. One that
// starts outside may not go farther.
constexpr double kMinFocalShare = 0.1;
constexpr double kMaxFocalShare = 20;

// Bundle adjustment (Triggs et al., 2000): poses, points and, if asked, cameras that minimise the
// sum of the robust squared reprojection errors, by bundle_solver.h. The first image stays where it is, and the distance to the
// one farthest from it keeps the scale. A lens that is no lens afterwards (not finite, or a focal
// length outside of the shares above) stays as it was. Throws Interrupted: the model is then as it
// was.
BundleReport adjust(Model& model, const BundleOptions& options, const std::stop_token& stop = {});

// The same for one image's pose alone, its points fixed; `seen`: pairs of pixel and point.
struct Correspondence2D3D {
  cv::Point2d pixel;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
};
void adjust_pose(geometry::Rigid3& pose, const geometry::Camera& camera,
                 const std::vector<Correspondence2D3D>& seen, double loss_px);

}  // namespace tarsier::sfm
