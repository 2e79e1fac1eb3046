// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <span>
#include <vector>

// Outlines of the dark regions of an image.
namespace tarsier::planar::markers {

struct OutlineOptions {
  // A region is flat if brightness varies by less than this over 12 x 12 px; a flat region has no
  // dark pixels. Grey levels. The value is raised, up to 64, if the flattest fifth of the image
  // varies by more, because of noise.
  int min_contrast = 20;
  int min_size = 8;  // px; the longer side of a component's bounding box

  [[nodiscard]] OptionFields fields() {
    return {{"min_contrast", min_contrast, range(2, 255)}, {"min_size", min_size, at_least(3)}};
  }
  void check() const { check_fields(*this); }
};

// Buffers that a video reuses, and the result.
struct OutlineWorkspace {
  struct Run {
    int first;  // x of a row's adjacent dark pixels, last included
    int last;
    int component;
  };
  struct Component {
    int parent;  // an earlier component that contains this one, or itself
    int x;       // of the leftmost pixel of its topmost row
    int y;
    int left;
    int right;
    int bottom;
    int runs;
  };
  struct Outline {
    std::size_t first;  // index in points
    std::size_t count;
  };
  std::vector<std::uint8_t> lows;
  std::vector<std::uint8_t> highs;
  std::vector<std::uint8_t> spread_lows;
  std::vector<std::uint8_t> spread_highs;
  std::vector<std::uint8_t> thresholds;
  std::vector<std::uint8_t> dark;  // 255 or 0, with a border of zeros
  std::vector<int> changes;
  // The runs of a row and of the next row.
  std::vector<Run> above;
  std::vector<Run> here;
  std::vector<Component> components;
  std::vector<cv::Point> points;
  std::vector<Outline> outlines;

  [[nodiscard]] std::span<const cv::Point> outline(std::size_t i) const {
    return std::span(points).subspan(outlines[i].first, outlines[i].count);
  }
};

// Fills `workspace.outlines`: the outer border of each connected dark component in `gray` (CV_8UC1)
// that is large enough and not ragged, clockwise in the image, pixel by pixel. A pixel is dark if
// it is below the mean of the darkest and the brightest pixel of the 3 x 3 surrounding tiles of 4 x
// 4 px (Wang & Olson, "AprilTag 2", IROS 2016). This needs no window size, works for markers of 12
// and of 400 px, and does not move the middle of a blurred edge. The components are 4-connected:
// with 8-connectivity, noise would connect a marker to its surroundings. The time is linear in the
// number of pixels.
void find_dark_outlines(const cv::Mat& gray, const OutlineOptions& options,
                        OutlineWorkspace& workspace);

}  // namespace tarsier::planar::markers
