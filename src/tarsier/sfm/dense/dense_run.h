// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/dense/dense_reconstructor.h"
#include "tarsier/sfm/dense/patch_match.h"

#include <opencv2/core/mat.hpp>

#include <string>

namespace tarsier::sfm {

// Implements DenseReconstructor::run(). Internal to this module.
[[nodiscard]] DenseResult run_dense(const DenseOptions& options, const DenseJob& job,
                                    Progress& progress, const std::stop_token& stop,
                                    DebugSink* debug);

// Colours from near (red) to far (blue), between the 2nd and 98th percentile of the known inverse
// depths; black where unknown. CV_8UC3.
[[nodiscard]] cv::Mat draw_depth(const cv::Mat& depth);
// Draws x, y and z of normals as red, green and blue.
[[nodiscard]] cv::Mat draw_normals(const cv::Mat& normals);

}  // namespace tarsier::sfm
