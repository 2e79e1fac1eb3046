// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <vector>

// Scale-invariant features (Lowe, Distinctive image features from scale-invariant keypoints, IJCV
// 2004), with descriptors as RootSIFT (Arandjelovic and Zisserman, CVPR 2012).
//
// Images are doubled and blurred to sigma 1.6, then in three steps per octave. Extrema of the
// differences of neighbouring blurs are refined by a quadratic in x, y and scale. Extrema of low
// contrast and on edges are left out. Unlike in the paper, orientation and descriptor are computed
// only for the kept points, from samples 0.75 sigma apart in the frame of the point.
namespace tarsier::sfm {

struct SiftOptions {
  int max_count = 8000;    // max features; the strongest in each region
  double contrast = 0.02;  // min contrast of an extremum, share of the grey range
  // For images of weak texture: where fewer positions than this have the contrast, those with a
  // quarter of it are added, up to this number. 0 disables it.
  int min_count = 1000;

  [[nodiscard]] OptionFields fields() {
    return {{"max_count", max_count, at_least(1)},
            {"contrast", contrast, range(0, 1)},
            {"min_count", min_count, at_least(0)}};
  }
  void check() const { check_fields(*this); }
};

struct SiftFeatures {
  std::vector<cv::Point2f> points;  // px, pixel centres at integers
  std::vector<float> sizes;         // px, 2 sigma
  // CV_8UC1, one row of 128 per feature: square roots of the shares, of length 512
  cv::Mat descriptors;
};

// `gray`: CV_8UC1, at least 8 x 8 (smaller: no features). Sorted by y, then x. Does not depend on
// the number of threads; instruction sets may differ in rounding. A position with several
// orientations gives several features. Throws std::invalid_argument for another type.
[[nodiscard]] SiftFeatures find_sift(const cv::Mat& gray, const SiftOptions& options);

// Indices of at most `max_count` of these, by importance. The image is divided into 16 cells along
// its longer side; the strongest of each cell come first, then the second of each ...
[[nodiscard]] std::vector<int> select_by_cells(const std::vector<cv::Point2f>& points,
                                               const std::vector<float>& responses, cv::Size size,
                                               int max_count);

}  // namespace tarsier::sfm
