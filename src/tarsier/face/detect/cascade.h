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

// Where Debian, Ubuntu, Raspberry Pi OS and a built OpenCV keep the cascade files; the folder that
// the environment variable TARSIER_CASCADES names comes first. Returns the path of `name`
// ("haarcascade_frontalface_alt2.xml") or "".
[[nodiscard]] std::string find_cascade(const std::string& name);

// A cascade of boosted classifiers: ours (haar_cascade.h) for upright Haar features, as the files of faces have, OpenCV's
// for others.
class Cascade {
 public:
  // Throws ModelError where find_cascade() does not find it, or OpenCV does not read it.
  explicit Cascade(const std::string& name);

  // The size of what it was trained on, px: it finds nothing smaller.
  [[nodiscard]] cv::Size window() const;

  struct Search {
    double step = 1.1;  // between sizes
    int neighbors = 3;  // boxes that must agree
    cv::Size min = {};  // px
    cv::Size max = {};  // px; empty: as large as the image
  };
  // Boxes within an 8-bit gray image.
  [[nodiscard]] std::vector<cv::Rect> detect(const cv::Mat& gray, const Search& search);

 private:
  std::optional<HaarCascade> haar_;
  cv::Ptr<cv::BaseCascadeClassifier> classifier_;  // where haar_ is empty
};

}  // namespace tarsier::face
