// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/detect/face_networks.h"

#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::face {

// Interface of an external face detector (face/onnx) that replaces the built-in ones.
class BoxDetector {
 public:
  virtual ~BoxDetector() = default;
  // Faces in `gray` (CV_8UC1), in any order: squares like those of OpenCV's frontal cascade, px;
  // scores 0..1. Thread-safe. Throws ModelError if the network fails.
  [[nodiscard]] virtual std::vector<ScoredFace> find(const cv::Mat& gray) const = 0;
};

}  // namespace tarsier::face
