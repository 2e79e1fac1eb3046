// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/image_targets/target.h"

#include <cstdint>
#include <stop_token>
#include <string>

namespace tarsier::planar::image_targets {

struct TrainOptions {
  double width = 0.2;          // metres of the print, (0, 100]
  int longer_side = 480;       // px that larger pictures are reduced to; 64..2000
  int frontal_features = 700;  // of the picture as it is, 50..5000
  int tilted_features = 350;   // of each tilted view, 0..5000
  int max_features = 3000;     // that are kept, 50..20000
  int trials = 24;  // warped, blurred and noisy views that tell which features last; 0..500
  std::uint64_t seed = 1;
  void check() const;
};

// `picture`: CV_8UC3 or CV_8UC1, sides of 32..100000 px, the shorter at least an eighth of the
// longer. Besides the picture as it is, views of it tilted by 48 and 60 degrees to several sides
// are described (as ASIFT: Morel and Yu, SIAM J. Imaging Sciences 2009), so that a steep view of
// the print needs no search over tilts. Never fails on a poor picture: its quality says so. Throws
// Interrupted where `stop` fires.
[[nodiscard]] Target train_target(const cv::Mat& picture, const std::string& name,
                                  const TrainOptions& options = {},
                                  const std::stop_token& stop = {});

}  // namespace tarsier::planar::image_targets
