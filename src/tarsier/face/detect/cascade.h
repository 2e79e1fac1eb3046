// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/detect/haar_cascade.h"

#include <opencv2/core.hpp>

#include <optional>
#include <string>
#include <vector>

namespace cv {
class BaseCascadeClassifier;
}

namespace tarsier::face {

// Searches the folder of the environment variable TARSIER_CASCADES, then those where Debian,
// Ubuntu, Raspberry Pi OS and a self-built OpenCV store the cascade files. Returns the path of
// `name` ("haarcascade_frontalface_alt2.xml") or "".
[[nodiscard]] std::string find_cascade(const std::string& name);

// A cascade of boosted classifiers: HaarCascade (haar_cascade.h) for upright Haar features, which
// the face files use, otherwise OpenCV's.
class Cascade {
 public:
  // Throws ModelError if find_cascade() does not find it, or OpenCV cannot read it.
  explicit Cascade(const std::string& name);

  // Window size of the training, px: smaller objects are not detected.
  [[nodiscard]] cv::Size window() const;

  struct Search {
    double step = 1.1;  // ratio between successive sizes
    int neighbors = 3;  // overlapping detections that are required
    cv::Size min = {};  // px
    cv::Size max = {};  // px; empty: as large as the image
  };
  // Boxes in an 8-bit grey image.
  [[nodiscard]] std::vector<cv::Rect> detect(const cv::Mat& gray, const Search& search);

 private:
  std::optional<HaarCascade> haar_;
  cv::Ptr<cv::BaseCascadeClassifier> classifier_;  // used if haar_ is empty
};

}  // namespace tarsier::face
