// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame.h"

#include <string>

namespace tarsier::planar {

// A frame for tests.
inline Frame frame_of(const cv::Mat& image, bool still, double time = 0,
                      const std::string& name = "desk.mp4") {
  Frame frame;
  frame.image = image;
  frame.still = still;
  frame.time = time;
  frame.name = name;
  return frame;
}

}  // namespace tarsier::planar
