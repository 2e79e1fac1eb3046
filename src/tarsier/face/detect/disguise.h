// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <vector>

// Draws things that people wear or hold in front of their faces on training views. Internal to this
// module.
namespace tarsier::face::training {

// Draws one or two of: sunglasses, a cap with its shadow, a beard, a hand or another object, hair
// on one side. `points`: the 68 of 300-W in the view, measured from the corners of pixels. Objects
// show `texture` (CV_8UC1, of the view's size) or one tone.
void disguise(cv::Mat& view, const std::vector<cv::Point2d>& points, const cv::Mat& texture,
              Rng& rng);

}  // namespace tarsier::face::training
