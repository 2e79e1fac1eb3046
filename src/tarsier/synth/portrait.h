// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <cstdint>

namespace tarsier::synth {

// A synthetic, shaded head with shoulders. It fills an ellipse of 70 % of the height in the centre
// of the image and moves slightly with `time_s`. The seed selects skin, hair, eyes, clothes and
// background.
struct PortraitTruth {
  cv::Rect2d box;        // of the face, hairline to chin, px
  cv::Point2d eyes[2];   // centres of the irises, the left one in the image first
  cv::Point2d nose;      // its tip
  cv::Point2d mouth[2];  // corners, the left one in the image first
};

struct Portrait {
  cv::Mat image;  // CV_8UC3
  // CV_8UC1: 255 where skin is visible (face, ears, neck; not eyes, brows, lips, hair).
  cv::Mat skin_mask;
  PortraitTruth truth;
};

// At least 16x16 px. No noise.
[[nodiscard]] Portrait render_portrait(cv::Size size, double time_s = 0, std::uint64_t seed = 1);

}  // namespace tarsier::synth
