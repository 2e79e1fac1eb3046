// SPDX-License-Identifier: MIT
#include "ui/overlay.h"

#include <fmt/format.h>

#include <utility>

namespace tarsier {
namespace {

constexpr double kNewestWeight = 0.1;  // share of the newest frame in the running mean

}  // namespace

std::string key_name(int key) {
  if (key == key::kSpace) return "space";
  if (key == key::kEnter) return "Enter";
  if (key == key::kEscape) return "Esc";
  return key > key::kSpace && key < 127 ? std::string(1, static_cast<char>(key)) : std::string();
}

void draw_help(cv::Mat& image, std::string_view title, const std::vector<Action>& actions,
               std::vector<image::draw::HelpLine> first) {
  for (const Action& action : actions) {
    if (std::string name = key_name(action.key); !name.empty()) {
      first.push_back({std::move(name), action.help});
    }
  }
  image::draw::help_overlay(image, title, first);
}

void FrameTimer::start() { start_ = std::chrono::steady_clock::now(); }

void FrameTimer::stop() {
  const auto passed = std::chrono::steady_clock::now() - start_;
  last_ms_ = std::chrono::duration<double, std::milli>(passed).count();
  mean_ms_ = mean_ms_ == 0 ? last_ms_ : (1 - kNewestWeight) * mean_ms_ + kNewestWeight * last_ms_;
}

std::string FrameTimer::text(bool still) const {
  return still || mean_ms_ <= 0
             ? fmt::format("{:.1f} ms", last_ms_)
             : fmt::format("{:.1f} ms, {:.0f} frames/s", mean_ms_, 1000 / mean_ms_);
}

}  // namespace tarsier
