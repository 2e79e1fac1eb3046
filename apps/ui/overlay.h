// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/image/draw/text.h"

#include <opencv2/core/mat.hpp>

#include "ui/session.h"
#include <chrono>
#include <string>
#include <string_view>
#include <vector>

// What the sessions' views share: the panel of keys, and how long a frame takes.
namespace tarsier {

// "s", "space", "Enter", "Esc"; "" for arrows and other keys without a letter, and for no key.
[[nodiscard]] std::string key_name(int key);

// The panel of all actions that have a key with a name, below the lines of `first`.
void draw_help(cv::Mat& image, std::string_view title, const std::vector<Action>& actions,
               std::vector<image::draw::HelpLine> first = {});

// How long the work on a frame takes, and usually took: a running mean of about ten frames.
class FrameTimer {
 public:
  void start();
  void stop();
  [[nodiscard]] double last_ms() const { return last_ms_; }
  [[nodiscard]] double usual_ms() const { return usual_ms_; }
  // "12.3 ms" of a `still`, "12.3 ms, 81 frames/s" of what usually is.
  [[nodiscard]] std::string words(bool still) const;

 private:
  std::chrono::steady_clock::time_point start_;
  double last_ms_ = 0;
  double usual_ms_ = 0;
};

}  // namespace tarsier
