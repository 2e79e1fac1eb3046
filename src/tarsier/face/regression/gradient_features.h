// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <vector>

// Histograms of oriented gradients around points, computed for all points of a face at once.
namespace tarsier::face::regression {

inline constexpr int kOrientations = 8;
inline constexpr int kCells = 4;                                     // per side
inline constexpr int kDescriptor = kCells * kCells * kOrientations;  // length of a descriptor

struct FeatureScale {
  // Resolution of the frame: pixels per unit of the mean shape's size (its RMS radius, about half
  // an eye distance).
  double px_per_unit = 60;
  double cell = 0.1;  // side of a cell, units

  [[nodiscard]] OptionFields fields() {
    return {{"px_per_unit", px_per_unit, range(5, 400)}, {"cell", cell, range(0.02, 1)}};
  }
  void check() const { check_fields(*this); }
};

// Buffers that are reused between calls. One per thread.
struct FeatureWorkspace {
  cv::Mat frame;                         // the face in the frame, CV_8UC1
  std::vector<std::uint16_t> gradients;  // y, x, orientation
  std::vector<std::uint16_t> rows;       // the same, summed along x
  std::vector<std::uint16_t> sums;       // also summed along y
  std::vector<std::uint16_t> columns;
};

// Descriptors of the points (2 x n, px of `gray`, CV_8UC1) as one row of n * kDescriptor numbers.
// They are computed in the frame to which `upright` maps the image: x_frame = upright x (2 x 3,
// units; its rotation and scale also rotate and scale the cells).
//
// In the frame, each pixel has a gradient g and eight half-wave rectified projections max(0, g .
// u_k) on directions u_k = (cos, sin)(45 k degrees) (Tola et al., "DAISY", PAMI 2010). They are
// summed over a cell around each pixel (in 16-bit integers: eight fill a register) and sampled
// bilinearly at the centres of 4 x 4 cells around each point. Each descriptor is normalised like
// SIFT (Lowe, IJCV 2004): length 1, elements clipped to 0.25, length 1 again.
void gradient_features(const cv::Mat& gray, const Eigen::Matrix<double, 2, 3>& upright,
                       const Eigen::Matrix2Xd& points, const FeatureScale& scale,
                       FeatureWorkspace& workspace, float* out);

}  // namespace tarsier::face::regression
