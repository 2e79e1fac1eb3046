// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/planar/image_targets/target.h"

#include <cstdint>
#include <stop_token>
#include <string>

namespace tarsier::planar::image_targets {

struct TrainOptions {
  double width = 0.2;          // of the print, metres
  int longer_side = 480;       // px; larger images are reduced to this size
  int frontal_features = 700;  // of the original image
  int tilted_features = 350;   // of each tilted view
  int max_features = 3000;     // that are kept
  int trials = 24;             // synthetic views that select repeatable features
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"width", width, above(0, 100)},
            {"longer_side", longer_side, range(64, 2000), "--side",
             "px, longer side of the reduced image"},
            {"frontal_features", frontal_features, range(50, 5000)},
            {"tilted_features", tilted_features, range(0, 5000)},
            {"max_features", max_features, range(50, 20'000)},
            {"trials", trials, range(0, 500), "--trials",
             "number of random views that select the features and rate the image"}};
  }
  void check() const { check_fields(*this); }
};

// `image`: CV_8UC3 or CV_8UC1, sides of 32..100000 px, the shorter at least an eighth of the
// longer. Besides the image itself, views of it tilted by 48 and 60 degrees in several directions
// are described (as in ASIFT: Morel and Yu, SIAM J. Imaging Sciences 2009). A steep view of the
// print therefore needs no search over tilts. A poor image does not cause an error; see its
// quality. Throws Interrupted if `stop` is requested.
[[nodiscard]] Target train_target(const cv::Mat& image, const std::string& name,
                                  const TrainOptions& options = {},
                                  const std::stop_token& stop = {});

}  // namespace tarsier::planar::image_targets
