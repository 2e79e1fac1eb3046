// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/image/draw/text.h"

#include <opencv2/core/mat.hpp>

#include "ui/session.h"
#include <chrono>
#include <string>
#include <string_view>
#include <vector>

// Parts shared by the views of all sessions: the panel of keys, and the time per frame.
namespace tarsier {

inline const cv::Scalar kBackground{38, 34, 30};  // of views without a frame behind them

// "s", "space", "Enter", "Esc"; "" for arrows, for other keys without a letter, and for no key.
[[nodiscard]] std::string key_name(int key);

// Draws the panel of all actions whose key has a name, below the lines of `first`.
void draw_help(cv::Mat& image, std::string_view title, const std::vector<Action>& actions,
               std::vector<image::draw::HelpLine> first = {});

// Measures the time per frame: the latest one and a running mean of about ten frames.
class FrameTimer {
 public:
  void start();
  void stop();
  [[nodiscard]] double last_ms() const { return last_ms_; }
  [[nodiscard]] double mean_ms() const { return mean_ms_; }
  // "12.3 ms" for a `still`; "12.3 ms, 81 frames/s" from the mean otherwise.
  [[nodiscard]] std::string text(bool still) const;

 private:
  std::chrono::steady_clock::time_point start_;
  double last_ms_ = 0;
  double mean_ms_ = 0;
};

}  // namespace tarsier
