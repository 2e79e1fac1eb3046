// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>

namespace tarsier::web {

// How good the images of one viewer may be, by the time in which it took those before: the best
// JPEG quality whose images it takes in 0.15 s each. The quality rises again where they would take
// 0.1 s at most, so that it does not go up and down. Has no clock: a function of what it is given.
class ViewerPace {
 public:
  static constexpr int kBest = 80;  // as a window has it at first
  static constexpr int kLeast = 30;

  // The viewer took `bytes` in `seconds` (>= 0), an image of JPEG quality `of_quality` among them.
  void took(std::size_t bytes, double seconds, int of_quality);

  [[nodiscard]] int quality() const { return quality_; }

 private:
  int quality_ = kBest;
  double bytes_ = 0;  // of the latest images, the newest counting most; as of kBest
  double seconds_ = 0;
  double images_ = 0;
  double sent_bytes_ = 0;  // as they were sent
};

}  // namespace tarsier::web
