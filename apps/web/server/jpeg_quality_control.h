// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>

namespace tarsier::web {

// Chooses the JPEG quality for one viewer from the times of earlier images: the best quality whose
// images take at most 0.15 s each. The quality rises again only if images would then take at most
// 0.1 s, so that it does not oscillate. It has no clock: the result depends only on its inputs.
class JpegQualityControl {
 public:
  static constexpr int kMaxQuality = 80;  // the initial quality of a window
  static constexpr int kMinQuality = 30;

  // The viewer took `bytes` in `seconds` (>= 0); they contained an image of JPEG quality
  // `of_quality`.
  void add_transfer(std::size_t bytes, double seconds, int of_quality);

  [[nodiscard]] int quality() const { return quality_; }

 private:
  int quality_ = kMaxQuality;
  // Of the latest images, weighted towards the newest; converted to kMaxQuality.
  double bytes_ = 0;
  double seconds_ = 0;
  double images_ = 0;
  double sent_bytes_ = 0;  // as sent
};

}  // namespace tarsier::web
