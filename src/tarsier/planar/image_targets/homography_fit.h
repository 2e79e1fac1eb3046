// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core.hpp>

#include <span>
#include <vector>

namespace tarsier::planar::image_targets {

// Where a point of the image was seen.
struct Sighting {
  cv::Point2d at;    // px of the image
  cv::Point2d seen;  // px of the frame
  // How well it is known, per square px: a matrix (a, b; b, c). At a straight edge nothing is known
  // along the edge.
  double a = 1;
  double b = 0;
  double c = 1;
};

struct HomographyFitOptions {
  int iterations = 8;
  double tolerance_px = 3;    // of Tukey's biweight: errors from here on do not count at all
  double sigma_px = 1;        // of a good sighting: against the prior below
  double perspective = 0.15;  // standard deviation of the change of depth from the image's
                              // middle to its corner, as a part of the depth
  bool affine = false;        // no perspective at all

  [[nodiscard]] OptionFields fields() {
    return {{"iterations", iterations, range(1, 1000)},
            {"tolerance_px", tolerance_px, above(0)},
            {"sigma_px", sigma_px, above(0)},
            {"perspective", perspective, above(0)}};
  }
  void check() const { check_fields(*this); }  // throws std::invalid_argument
};

// Refines `h` (px of the frame from px of the image, of `size`), by Gauss-Newton, to the least
// sum of robust squared errors weighted by what each sighting knows, plus the prior on perspective.
// False, and `h` as it was, where fewer than 3 sightings count or the equations are singular.
// Throws std::invalid_argument for bad options.
[[nodiscard]] bool fit_homography(cv::Matx33d& h, cv::Size size,
                                  std::span<const Sighting> sightings,
                                  const HomographyFitOptions& options);

// Standard deviation, px of the frame, of the least certain corner of the image's edge under `h`,
// when each sighting is off by `sigma_px`: what the sightings do not pin down shows here. Infinite
// where they determine no homography.
[[nodiscard]] double corner_deviation(const cv::Matx33d& h, cv::Size size,
                                      std::span<const Sighting> sightings, double sigma_px,
                                      double perspective = 0.15);

// Root of the sighting's weighted squared error.
[[nodiscard]] double error_of(const cv::Matx33d& h, const Sighting& sighting);

// The image of the image is a convex quadrilateral of the same orientation before the camera,
// with an area of at least `min_area_px`, and no corner far outside of `frame`.
[[nodiscard]] bool is_plausible(const cv::Matx33d& h, cv::Size size, cv::Size frame,
                                double min_area_px);

}  // namespace tarsier::planar::image_targets
