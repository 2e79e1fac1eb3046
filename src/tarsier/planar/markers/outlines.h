// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <span>
#include <vector>

// The outlines of what is dark in an image.
namespace tarsier::planar::markers {

struct OutlineOptions {
  // A place is flat where brightness differs by less over 12 x 12 px: nothing there is dark. Grey
  // levels. Raised, up to 64, where the flattest fifth of the image differs by more:
  // noise.
  int min_contrast = 20;
  int min_size = 8;  // px; the longer side of a component's bounding box

  [[nodiscard]] OptionFields fields() {
    return {{"min_contrast", min_contrast, range(2, 255)}, {"min_size", min_size, at_least(3)}};
  }
  void check() const { check_fields(*this); }
};

// Buffers that a video reuses, and the answer.
struct OutlineWorkspace {
  struct Run {
    int first;  // x of a row's dark pixels that lie beside each other, last included
    int last;
    int component;
  };
  struct Component {
    int parent;  // an earlier component that this is a part of, or itself
    int x;       // of its topmost row's leftmost pixel
    int y;
    int left;
    int right;
    int bottom;
    int runs;
  };
  struct Outline {
    std::size_t first;  // into points
    std::size_t count;
  };
  std::vector<std::uint8_t> lows;
  std::vector<std::uint8_t> highs;
  std::vector<std::uint8_t> spread_lows;
  std::vector<std::uint8_t> spread_highs;
  std::vector<std::uint8_t> thresholds;
  std::vector<std::uint8_t> dark;  // 255 or 0, a frame of zeros around
  std::vector<int> changes;
  std::vector<Run> above;  // of a row, and of the next
  std::vector<Run> here;
  std::vector<Component> components;
  std::vector<cv::Point> points;
  std::vector<Outline> outlines;

  [[nodiscard]] std::span<const cv::Point> outline(std::size_t i) const {
    return std::span(points).subspan(outlines[i].first, outlines[i].count);
  }
};

// Fills `workspace.outlines`: for each connected dark component in `gray` (CV_8UC1) that is large
// enough and not ragged, its outer border, clockwise as seen, pixel by pixel. Dark is what lies
// below the middle between the darkest and the brightest pixel of the 3 x 3 tiles of 4 x 4 px
// around (Wang & Olson, "AprilTag 2", IROS 2016): no window to choose, the same for a marker of 12
// and of 400 px, and the middle of a blurred edge stays where the edge was. Pixels that touch only
// at a corner are not connected: noise would tie a marker to what is beside it. Linear in the
// number of pixels.
void find_dark_outlines(const cv::Mat& gray, const OutlineOptions& options,
                        OutlineWorkspace& workspace);

}  // namespace tarsier::planar::markers
