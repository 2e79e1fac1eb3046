// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::plate {

// A character cropped from a rectified plate.
struct Segment {
  cv::Rect box;       // px of the plate
  cv::Mat character;  // 20x20, bright on dark
};

struct SegmentOptions {
  double aspect = 45.0 / 77;      // width / height
  double aspect_error = 0.35;     // maximum relative error
  double min_aspect = 0.2;        // minimum for the digit 1
  double max_fill = 0.8;          // maximum share of ink in the box
  double min_height = 15.0 / 33;  // relative to the plate's height
  double max_height = 28.0 / 33;

  [[nodiscard]] OptionFields fields() {
    return {{"aspect", aspect, above(0)},
            {"aspect_error", aspect_error, inside(0, 1)},
            {"min_aspect", min_aspect, above(0)},
            {"max_fill", max_fill, above(0, 1)},
            {"min_height", min_height, inside(0, 1)},
            {"max_height", max_height, above(0, 1)}};
  }
  void check() const;
};

// Segments the characters of a plate (CV_8UC1, dark ink on a bright plate), from left to right. Ink
// is darker than `threshold` (0..255). Segments are contours with the size and shape of characters.
[[nodiscard]] std::vector<Segment> find_segments(const cv::Mat& plate, int threshold,
                                                 const SegmentOptions& options);

}  // namespace tarsier::plate
