// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core.hpp>

#include <cstdint>
#include <string>
#include <vector>

// Points of an image that can be found again in others, and their descriptions.
namespace tarsier::sfm {

enum class FeatureKind {
  kSift,   // Lowe, IJCV 2004; descriptors as RootSIFT (Arandjelovic and Zisserman, CVPR 2012)
  kOrb,    // Rublee et al., ICCV 2011
  kAkaze,  // Alcantarilla et al., BMVC 2013
};

struct FeatureOptions {
  FeatureKind kind = FeatureKind::kSift;
  int max_count = 8000;     // of an image, the strongest of each place
  double max_pixels = 4e6;  // larger images are reduced to so many before
  double contrast = 0.02;   // of SIFT's extrema; lower: more and weaker ones
  bool wide = false;        // of SIFT: those of simulated views as well (simulated_views.h)

  [[nodiscard]] OptionFields fields() {
    return {
        {"max_count", max_count, range(100, 100'000), "--max-features",
         "features of an image, at most"},
        {"max_pixels", max_pixels, range(1e4, 1e9)},
        {"contrast", contrast, range(0.001, 0.2), "--contrast",
         "min contrast of SIFT, share of the grey range"},
        {"wide", wide, "--wide",
         "wide baselines: SIFT of simulated views of each image as well, 5 to 10 times slower"}};
  }
  void check() const { check_fields(*this); }
};

struct Features {
  std::vector<cv::Point2f> points;  // px of the whole image, pixel centres at integers
  std::vector<float> sizes;         // px, diameter
  std::vector<cv::Vec3b> colors;    // BGR
  cv::Mat descriptors;  // a row each; SIFT: CV_8UC1 128, square roots scaled so that a row's length
                        // is about 512; ORB, AKAZE: CV_8UC1 bits
  // Of the rows of `descriptors` beyond one a point: the point that each describes as well, as a simulated view shows it.
  // Empty but for FeatureOptions::wide.
  std::vector<std::int32_t> owners;
};

// `image`: CV_8UC3 or CV_8UC1. The same for any number of threads. Places are spread: of a grid of
// cells each keeps its strongest ones. Points of several orientations at one place count once each. `wide`: the points of before come
// first, then places that only simulated views show.
[[nodiscard]] Features find_features(const cv::Mat& image, const FeatureOptions& options);

}  // namespace tarsier::sfm
