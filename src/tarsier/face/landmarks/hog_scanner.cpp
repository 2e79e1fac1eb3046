// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/hog_scanner.h"

#include <dlib/opencv/cv_image.h>

namespace tarsier::face::landmarks::inner {

void HogScanner::load(const cv::Mat& gray) {
  if (stop_.stop_requested()) return;
  HogScannerBase::load(dlib::cv_image<unsigned char>(gray));
}

}  // namespace tarsier::face::landmarks::inner
