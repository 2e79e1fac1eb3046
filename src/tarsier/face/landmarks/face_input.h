// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::face::landmarks {

// Buffers of face_input().
struct FaceInput {
  cv::Mat frame;              // CV_8UC1
  std::vector<float> values;  // of the frame, row by row: grey levels of mean 0 and deviation 1
};

// The face in the frame of its points: `side` px a side, the mean shape (2 x n, size 1) upright in its middle and
// `scale` px to its size. Points 2 x n, px of `gray` (CV_8UC1). What lies outside the image repeats its edge.
void face_input(const Eigen::Matrix2Xd& mean, const cv::Mat& gray, const Eigen::Matrix2Xd& points,
                int side, double scale, FaceInput& input);

}  // namespace tarsier::face::landmarks
