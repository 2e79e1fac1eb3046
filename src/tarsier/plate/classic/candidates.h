// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/core/rng.h"
#include "tarsier/plate/text/reading.h"

#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::plate {

// A region that may be a plate.
struct ClassicCandidate {
  Quad corners{};  // in the image
  cv::Mat gray;    // 144x33, rectified, 3x3 blurred, equalised
  cv::Mat plain;   // the same at three times the size, not equalised; characters are segmented here
};

struct CandidateOptions {
  double aspect = 520.0 / 110;  // width / height
  double aspect_error = 0.4;    // maximum relative error, in either direction
  double min_height = 15;       // px of the scaled image
  double max_height = 125;
  int seeds = 10;        // number of seeds of the flood fill
  int flood_range = 30;  // grey levels

  [[nodiscard]] OptionFields fields() {
    return {{"aspect", aspect, inside(1, 20)},    {"aspect_error", aspect_error, inside(0, 1)},
            {"min_height", min_height, above(1)}, {"max_height", max_height, above(1)},
            {"seeds", seeds, range(1, 1000)},     {"flood_range", flood_range, range(0, 255)}};
  }
  void check() const;
};

// Finds candidates in a grey image (CV_8UC1) at one scale. Steps: vertical edges (5x5 blur, Sobel),
// Otsu's threshold, closing 17x3, contours whose rotated box has the shape of a plate. The white
// plate is then flood-filled from random points; its rotated box is used if it has the shape of a
// plate as well.
[[nodiscard]] std::vector<ClassicCandidate> find_candidates(const cv::Mat& gray,
                                                            const CandidateOptions& options,
                                                            Rng rng, DebugSink* debug);

// Corners of a rotated box with its long sides horizontal: top left first, clockwise. It uses only
// the points, because the meaning of cv::RotatedRect's angle changed in OpenCV 4.5.1.
[[nodiscard]] Quad upright_corners(const cv::RotatedRect& box);

}  // namespace tarsier::plate
