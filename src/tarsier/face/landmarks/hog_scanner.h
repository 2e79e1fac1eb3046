// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/landmarks/hog_detector.h"

#include <opencv2/core/mat.hpp>

#include <dlib/image_processing/object_detector.h>
#include <dlib/image_processing/scan_fhog_pyramid.h>
#include <stop_token>

// Access to dlib for the .cpp files of this module only.
namespace tarsier::face::landmarks::inner {

using HogPyramid = dlib::pyramid_down<6>;
using HogScannerBase = dlib::scan_fhog_pyramid<HogPyramid>;

// dlib's scanner for images of OpenCV. After a stop request it loads no more images.
class HogScanner : public HogScannerBase {
 public:
  void load(const cv::Mat& gray);
  void copy_configuration(const HogScanner& other) {
    HogScannerBase::copy_configuration(other);
    stop_ = other.stop_;
  }
  void stop_by(std::stop_token stop) { stop_ = std::move(stop); }
  void configure(const HogDetector& detector) {
    set_detection_window_size(static_cast<unsigned long>(detector.width),
                              static_cast<unsigned long>(detector.height));
    set_cell_size(static_cast<unsigned long>(detector.cell));
    set_padding(static_cast<unsigned long>(detector.padding));
  }

 private:
  std::stop_token stop_;
};

inline dlib::rectangle to_dlib(const cv::Rect2d& box) {
  const auto left = static_cast<long>(std::lround(box.x));
  const auto top = static_cast<long>(std::lround(box.y));
  return {left, top, left + std::max(1L, std::lround(box.width)) - 1,
          top + std::max(1L, std::lround(box.height)) - 1};
}

inline cv::Rect2d from_dlib(const dlib::rectangle& box) {
  return {static_cast<double>(box.left()), static_cast<double>(box.top()),
          static_cast<double>(box.width()), static_cast<double>(box.height())};
}

}  // namespace tarsier::face::landmarks::inner
