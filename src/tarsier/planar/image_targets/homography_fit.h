// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core.hpp>

#include <span>
#include <vector>

namespace tarsier::planar::image_targets {

// An observation of a point of the image.
struct Correspondence {
  cv::Point2d at;    // px of the image
  cv::Point2d seen;  // px of the frame
  // Information matrix (a, b; b, c), per square px. At a straight edge it has no information along
  // the edge.
  double a = 1;
  double b = 0;
  double c = 1;
};

struct HomographyFitOptions {
  int iterations = 8;
  double tolerance_px = 3;  // of Tukey's biweight: larger errors have no weight
  double sigma_px = 1;      // of a good sighting, relative to the prior below
  // Standard deviation of the change in depth from the image's centre to its corner, relative to
  // the depth.
  double perspective = 0.15;
  bool affine = false;  // no perspective

  [[nodiscard]] OptionFields fields() {
    return {{"iterations", iterations, range(1, 1000)},
            {"tolerance_px", tolerance_px, above(0)},
            {"sigma_px", sigma_px, above(0)},
            {"perspective", perspective, above(0)}};
  }
  void check() const { check_fields(*this); }  // throws std::invalid_argument
};

// Refines `h` (from px of the image, of `size`, to px of the frame) by Gauss-Newton. It minimises
// the sum of robust squared errors, weighted by the information matrices, plus the prior on
// perspective. Returns false, with `h` unchanged, if fewer than 3 sightings have weight or the
// equations are singular. Throws std::invalid_argument for bad options.
[[nodiscard]] bool fit_homography(cv::Matx33d& h, cv::Size size,
                                  std::span<const Correspondence> correspondences,
                                  const HomographyFitOptions& options);

// Standard deviation, px of the frame, of the least certain corner of the image under `h`, if each
// sighting has an error of `sigma_px`. It is large if the sightings do not constrain the homography
// well. Infinite if they do not determine it.
[[nodiscard]] double corner_deviation(const cv::Matx33d& h, cv::Size size,
                                      std::span<const Correspondence> correspondences,
                                      double sigma_px, double perspective = 0.15);

// Square root of the sighting's weighted squared error.
[[nodiscard]] double error_of(const cv::Matx33d& h, const Correspondence& correspondence);

// Whether the projected image is a convex quadrilateral of unchanged orientation in front of the
// camera, with an area of at least `min_area_px` and no corner far outside the frame.
[[nodiscard]] bool is_plausible(const cv::Matx33d& h, cv::Size size, cv::Size frame,
                                double min_area_px);

}  // namespace tarsier::planar::image_targets
