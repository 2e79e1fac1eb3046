// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core/mat.hpp>

namespace tarsier::plate {

struct MotionOptions {
  // Grey levels by which a cell differs from the background. 0: everything moves.
  double threshold = 6;
  int min_cells = 4;  // that differ; a cell is 1/160 of the image's width
  // Share of a cell's difference that goes into the background with each frame, and less where
  // something moves: what has stopped is background after so many frames.
  double learning = 0.1;
  double learning_moving = 0.02;

  [[nodiscard]] OptionFields fields() {
    return {{"threshold", threshold, range(0, 255), "--motion",
             "grey levels of a change that counts; 0: each frame is read"},
            {"min_cells", min_cells, range(1, 10'000)},
            {"learning", learning, range(0, 1)},
            {"learning_moving", learning_moving, range(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

struct MotionState {
  cv::Mat background;  // CV_32FC1, grey levels of the cells; empty before the first frame
  cv::Mat moved;       // CV_64FC1, s: when each of them last differed
};

// Whether something moves before a camera that stands: the image, reduced to 160 cells across, is
// compared with a running mean of the frames before it (Wren et al., Pfinder, PAMI 1997, without the
// variance). A change that all cells share, as a cloud or the camera's exposure makes it, is taken
// out by its median. The first frame moves. `image`: CV_8UC3 (BGR) or CV_8UC1; another size than
// before begins again. `time`: of the frame, s.
[[nodiscard]] bool has_motion(const MotionOptions& options, MotionState& state,
                              const cv::Mat& image, double time = 0);

// The box around all cells that differed at `since` s or later and a margin of 1/40 of the image's width, in px of
// an image of `size`, cut to it. Empty where none did; the whole image before the first frame and where
// the threshold is 0.
[[nodiscard]] cv::Rect moved_part(const MotionState& state, double since, cv::Size size);

}  // namespace tarsier::plate
