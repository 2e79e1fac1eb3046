// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

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

// A cascade of boosted classifiers (Viola and Jones, 2001), run by OpenCV.
class Cascade {
 public:
  // Throws ModelError where find_cascade() does not find it, or OpenCV does not read it.
  explicit Cascade(const std::string& name);

  // The size of what it was trained on, px: it finds nothing smaller.
  [[nodiscard]] cv::Size window() const;

  struct Search {
    double step = 1.1;  // between sizes
    int neighbors = 3;  // boxes that must agree
    int flags = 0;      // cv::CASCADE_*
    cv::Size min = {};  // px
    cv::Size max = {};  // px; empty: as large as the image
  };
  // Boxes within an 8-bit gray image, in the order in which OpenCV finds them.
  [[nodiscard]] std::vector<cv::Rect> detect(const cv::Mat& gray, const Search& search);

 private:
  cv::Ptr<cv::BaseCascadeClassifier> classifier_;
};

}  // namespace tarsier::face
