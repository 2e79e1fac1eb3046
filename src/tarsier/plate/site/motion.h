// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core/mat.hpp>

namespace tarsier::plate {

struct MotionOptions {
  // A cell has changed if it differs from the background by more than this many grey levels. With 0
  // every frame counts as moving.
  double threshold = 6;
  int min_cells = 4;  // that changed, for motion; a cell is 1/160 of the image's width
  // Share of a cell's difference that is added to the background in each frame. The rate is lower
  // for changed cells, so an object that stops becomes background only slowly.
  double learning = 0.1;
  double learning_moving = 0.02;

  [[nodiscard]] OptionFields fields() {
    return {{"threshold", threshold, range(0, 255), "--motion",
             "grey levels, minimum change that counts as motion; 0: read every frame"},
            {"min_cells", min_cells, range(1, 10'000)},
            {"learning", learning, range(0, 1)},
            {"learning_moving", learning_moving, range(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

struct MotionState {
  cv::Mat background;        // CV_32FC1, grey levels of the cells; empty before the first frame
  cv::Mat last_change_time;  // CV_64FC1, s: last time at which each cell changed
};

// Returns whether something moves in the view of a fixed camera. The image is reduced to 160 cells
// across and compared with a running mean of the earlier frames (Wren et al., Pfinder, PAMI 1997,
// without the variance). The median change of all cells is subtracted, so a cloud or a change of
// exposure is not motion. The first frame counts as moving. `image` is CV_8UC3 (BGR) or CV_8UC1; a
// change of its size restarts the background. `time` is the time of the frame, s.
[[nodiscard]] bool has_motion(const MotionOptions& options, MotionState& state,
                              const cv::Mat& image, double time = 0);

// The bounding box of all cells that changed at `since` s or later, with a margin of 1/40 of the
// image's width, in px of an image of `size` and clipped to it. It is empty if no cell changed. It
// is the whole image before the first frame and if the threshold is 0.
[[nodiscard]] cv::Rect motion_box(const MotionState& state, double since, cv::Size size);

}  // namespace tarsier::plate
