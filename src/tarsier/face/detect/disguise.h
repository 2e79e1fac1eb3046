// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <vector>

// What people wear and hold before their faces, drawn over training views. Internal to this module.
namespace tarsier::face::training {

// One or two of: sunglasses, a cap with its shadow, a beard, a hand or another object, hair at one
// side. `points`: the 68 of 300-W in the view, from the corners of pixels. Objects show `texture`
// (CV_8UC1, of the view's size) or one tone.
void disguise(cv::Mat& view, const std::vector<cv::Point2d>& points, const cv::Mat& texture,
              Rng& rng);

}  // namespace tarsier::face::training
