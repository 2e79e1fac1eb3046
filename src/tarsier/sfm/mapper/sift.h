// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <vector>

// The scale-invariant features of Lowe (Distinctive image features from scale-invariant keypoints,
// IJCV 2004), with descriptors as RootSIFT (Arandjelovic and Zisserman, CVPR 2012).
//
// Images are doubled, blurred to sigma 1.6 and then in three steps an octave. Extrema of the
// differences of neighbouring blurs are refined by a quadratic in x, y and scale; those of little
// contrast and on edges are left out. Unlike the paper, orientation and descriptor are computed for
// the points that are kept alone, from samples 0.75 sigma apart in the frame of the point.
namespace tarsier::sfm {

struct SiftOptions {
  int max_count = 8000;    // features; the strongest of each place
  double contrast = 0.02;  // min of an extremum, share of the grey range
  // Where fewer places than this have the contrast, those with a quarter of it come in as well, up to
  // this number: images of weak texture. 0: never.
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
  cv::Mat descriptors;  // CV_8UC1, a row of 128 each: square roots of the shares, of length 512
};

// `gray`: CV_8UC1, at least 8 x 8 (smaller: no features). By y, then x. The same for any number of
// threads; another instruction set may round otherwise. A place with several orientations gives
// several features. Throws std::invalid_argument for another type.
[[nodiscard]] SiftFeatures find_sift(const cv::Mat& gray, const SiftOptions& options);

// Indices of at most `most` of these, in order of importance: the image is divided into 16 cells
// along its larger side; the strongest of each cell come first, then the second of each ..
[[nodiscard]] std::vector<int> spread(const std::vector<cv::Point2f>& points,
                                      const std::vector<float>& responses, cv::Size size, int most);

}  // namespace tarsier::sfm
