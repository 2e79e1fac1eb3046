// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/planar/image_targets/kernels.h"

#include <opencv2/core.hpp>

#include <array>
#include <cstdint>
#include <vector>

// Keypoints that are repeatable under rotation, scale and moderate tilt, with descriptors that are
// compared fast.
//
// Keypoints are maxima of the determinant of the Hessian (Beaudet 1978; Lindeberg, IJCV 1998) on a
// pyramid whose levels differ by a factor of the square root of 2. Each keypoint has one or two
// dominant gradient orientations. In the rotated patch, gradients are pooled into 4x4 cells of 8
// directions (Lowe, IJCV 2004, with DAISY's weights: Tola et al., PAMI 2010) and square-rooted
// (RootSIFT). A binary sketch of 256 comparisons between descriptor values speeds up the search.
namespace tarsier::planar::image_targets {

// One smoothed level of an image, with a margin of replicated pixels around it.
struct Level {
  static constexpr int kMargin = 20;  // px
  cv::Mat padded;                     // CV_8UC1
  int width = 0;                      // without the margin
  int height = 0;
  double step_x = 1;  // px of the image per px of this level
  double step_y = 1;

  [[nodiscard]] const std::uint8_t* row(int y) const {
    return padded.ptr<std::uint8_t>(y + kMargin) + kMargin;
  }
  [[nodiscard]] cv::Mat inner() const { return padded(cv::Rect(kMargin, kMargin, width, height)); }
  [[nodiscard]] cv::Point2d to_image(cv::Point2d p) const {
    return {(p.x + 0.5) * step_x - 0.5, (p.y + 0.5) * step_y - 0.5};
  }
  [[nodiscard]] cv::Point2d from_image(cv::Point2d p) const {
    return {(p.x + 0.5) / step_x - 0.5, (p.y + 0.5) / step_y - 0.5};
  }
};

struct Pyramid {
  // Levels 0, 2, 4 .. halve each time. The odd levels lie between them; they are empty if not
  // requested.
  std::vector<Level> levels;
};

// `gray`: CV_8UC1, at least 8x8. The last level has a shorter side of at least `min_side` px.
[[nodiscard]] Pyramid make_pyramid(const cv::Mat& gray, bool half_steps, int min_side = 40,
                                   int max_levels = 12);

struct Feature {
  cv::Point2f at;      // px of the image, pixel centres at integers
  float scale = 1;     // px of the image per px of its level
  float angle = 0;     // radians, from x towards y
  float response = 0;  // of the detector, comparable within one level
  int level = 0;
};

struct Descriptor {
  Sketch sketch{};
  std::array<std::uint8_t, kDescriptorSize> values{};  // norm about 256
};

struct FeatureOptions {
  int max_features = 1000;  // maximum number of points; a few have two orientations
  double contrast = 12;     // grey levels: minimum square root of the Hessian's determinant
  bool second_directions = true;

  [[nodiscard]] OptionFields fields() {
    return {{"most", max_features, range(10, 100'000)}, {"contrast", contrast, range(1, 255)}};
  }
  void check() const { check_fields(*this); }
};

struct FeatureSet {
  std::vector<Feature> features;
  std::vector<Descriptor> descriptors;  // of each feature
};

// Keypoints are spread over the image: the score of a point is lowered for each stronger point in
// its cell.
[[nodiscard]] FeatureSet find_features(const Pyramid& pyramid, const FeatureOptions& options);

}  // namespace tarsier::planar::image_targets
