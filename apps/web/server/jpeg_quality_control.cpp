// SPDX-License-Identifier: MIT
#include "jpeg_quality_control.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace tarsier::web {
namespace {

constexpr double kSlow_s = 0.15;  // maximum time for an image
constexpr double kQuick_s = 0.1;  // maximum time for one of better quality
constexpr double kForgettingFactor =
    0.7;  // factor on the weight of earlier images for each new one

// Size of an image by its quality, relative to kMaxQuality: the mean over the drawings of six verbs
// (cartoon, sketch, pose, plates, markers); each is within 25 % of it.
struct Step {
  int quality;
  double size;
};
constexpr std::array<Step, 5> kSteps{{{80, 1}, {70, 0.8}, {55, 0.64}, {40, 0.55}, {30, 0.48}}};
static_assert(kSteps.front().quality == JpegQualityControl::kMaxQuality);
static_assert(kSteps.back().quality == JpegQualityControl::kMinQuality);

double size_of(int quality) {
  for (const Step& step : kSteps)
    if (quality >= step.quality) return step.size;
  return kSteps.back().size;
}

}  // namespace

void JpegQualityControl::add_transfer(std::size_t bytes, double seconds, int of_quality) {
  const auto count = static_cast<double>(bytes);
  bytes_ = kForgettingFactor * bytes_ + count / size_of(of_quality);
  sent_bytes_ = kForgettingFactor * sent_bytes_ + count;
  seconds_ = kForgettingFactor * seconds_ + std::max(0.0, seconds);
  images_ = kForgettingFactor * images_ + 1;
  if (sent_bytes_ <= 0) return;
  // Time for an image of the best quality.
  const double best_s = bytes_ / images_ * seconds_ / sent_bytes_;
  for (const Step& step : kSteps) {
    const double allowed = step.quality > quality_ ? kQuick_s : kSlow_s;
    if (best_s * step.size > allowed && step.quality != kMinQuality) continue;
    quality_ = step.quality;
    return;
  }
}

}  // namespace tarsier::web
