// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

namespace tarsier::synth {

inline bool is_same(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0;
}

}  // namespace tarsier::synth
