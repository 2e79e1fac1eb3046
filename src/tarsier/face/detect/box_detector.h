// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/detect/face_networks.h"

#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::face {

// A face detector that somebody else's code runs (face/onnx), in place of ours.
class BoxDetector {
 public:
  virtual ~BoxDetector() = default;
  // Faces in `gray` (CV_8UC1), in any order: squares as OpenCV's frontal cascade draws them, px;
  // scores 0..1. Any number of threads may call it. Throws ModelError where the network fails.
  [[nodiscard]] virtual std::vector<ScoredFace> find(const cv::Mat& gray) const = 0;
};

}  // namespace tarsier::face
