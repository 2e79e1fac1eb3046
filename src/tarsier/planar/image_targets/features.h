// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/planar/image_targets/kernels.h"

#include <opencv2/core.hpp>

#include <array>
#include <cstdint>
#include <vector>

// Points of an image that are found again after turning, scaling and moderate tilt, with a
// description of their surroundings that is compared fast.
//
// Blobs and corners are maxima of the determinant of the Hessian (Beaudet 1978; Lindeberg, IJCV
// 1998) on a pyramid whose levels are the square root of 2 apart. Each gets the directions in which
// most of the gradient points, and, turned there, gradients pooled into 4x4 cells of 8 directions
// (Lowe, IJCV 2004, with DAISY's weights: Tola et al., PAMI 2010), as square roots (RootSIFT). 256
// comparisons of pairs of these numbers are a sketch of bits for fast search.
namespace tarsier::planar::image_targets {

// One level of an image, smoothed, with a margin of replicated pixels around it.
struct Level {
  static constexpr int kMargin = 20;  // px
  cv::Mat padded;                     // CV_8UC1
  int width = 0;                      // without the margin
  int height = 0;
  double step_x = 1;  // px of the image for one of this level
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
  // Levels 0, 2, 4 .. halve each time; the odd ones are between, empty where not asked for.
  std::vector<Level> levels;
};

// `gray`: CV_8UC1 of at least 8x8. Levels until the shorter side would be below `min_side` px.
[[nodiscard]] Pyramid make_pyramid(const cv::Mat& gray, bool half_steps, int min_side = 40,
                                   int max_levels = 12);

struct Feature {
  cv::Point2f at;      // px of the image, pixel centres at integers
  float scale = 1;     // px of the image for one of its level
  float angle = 0;     // radians, from x towards y
  float response = 0;  // of the detector, comparable within a level
  int level = 0;
};

struct Description {
  Sketch sketch{};
  std::array<std::uint8_t, kDescriptorSize> values{};  // length about 256
};

struct FeatureOptions {
  int most = 1000;       // points; a few have two directions
  double contrast = 12;  // grey steps: least square root of the Hessian's determinant
  bool second_directions = true;

  [[nodiscard]] OptionFields fields() {
    return {{"most", most, range(10, 100'000)}, {"contrast", contrast, range(1, 255)}};
  }
  void check() const { check_fields(*this); }
};

struct FeatureSet {
  std::vector<Feature> features;
  std::vector<Description> descriptions;  // of each feature
};

// Spread over the image: a point's strength counts less for each stronger one in its cell.
[[nodiscard]] FeatureSet find_features(const Pyramid& pyramid, const FeatureOptions& options);

}  // namespace tarsier::planar::image_targets
