// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::face::regression {

// Buffers of face_input().
struct FaceInput {
  cv::Mat frame;              // CV_8UC1
  std::vector<float> values;  // of the frame, row by row: grey levels with mean 0 and deviation 1
};

// The face in the frame of its points: `side` px wide, the mean shape (2 x n, size 1) upright in
// the middle with `scale` px per unit of its size. Points 2 x n, px of `gray` (CV_8UC1). Outside
// the image, the border is replicated.
void face_input(const Eigen::Matrix2Xd& mean, const cv::Mat& gray, const Eigen::Matrix2Xd& points,
                int side, double scale, FaceInput& input);

}  // namespace tarsier::face::regression
