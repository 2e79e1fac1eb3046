// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core.hpp>

#include <cstdint>
#include <string>
#include <vector>

// Image points that can be found again in other images, with descriptors.
namespace tarsier::sfm {

enum class FeatureKind {
  kSift,   // Lowe, IJCV 2004; descriptors as RootSIFT (Arandjelovic and Zisserman, CVPR 2012)
  kOrb,    // Rublee et al., ICCV 2011
  kAkaze,  // Alcantarilla et al., BMVC 2013
};

struct FeatureOptions {
  FeatureKind kind = FeatureKind::kSift;
  int max_count = 8000;     // per image; the strongest in each region
  double max_pixels = 4e6;  // larger images are reduced to this size
  // min contrast of SIFT extrema; lower values give more and weaker features
  double contrast = 0.02;
  bool wide = false;  // SIFT only: also features of simulated views (simulated_views.h)

  [[nodiscard]] OptionFields fields() {
    return {
        {"max_count", max_count, range(100, 100'000), "--max-features",
         "maximum number of features in an image"},
        {"max_pixels", max_pixels, range(1e4, 1e9)},
        {"contrast", contrast, range(0.001, 0.2), "--contrast",
         "minimum contrast of SIFT features, share of the grey range"},
        {"wide", wide, "--wide",
         "wide baselines: SIFT on simulated views of each image as well; 5 to 10 times slower"}};
  }
  void check() const { check_fields(*this); }
};

struct Features {
  std::vector<cv::Point2f> points;  // px of the full image, pixel centres at integers
  std::vector<float> sizes;         // px, diameter
  std::vector<cv::Vec3b> colors;    // BGR
  // One row per feature. SIFT: CV_8UC1 128, square roots scaled to a row length of about 512. ORB,
  // AKAZE: CV_8UC1 bits.
  cv::Mat descriptors;
  // Descriptors from simulated views follow the rows of the points. For each of these further rows:
  // the point that it also describes. Empty without FeatureOptions::wide.
  std::vector<std::int32_t> owners;
};

// `image`: CV_8UC3 or CV_8UC1. Does not depend on the number of threads. Features are spread over
// the image: each cell of a grid keeps its strongest ones. Several orientations at one position
// count separately. `wide`: the ordinary points come first, then those that only simulated views
// show.
[[nodiscard]] Features find_features(const cv::Mat& image, const FeatureOptions& options);

}  // namespace tarsier::sfm
