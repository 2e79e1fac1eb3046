// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/at.h"
#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <cstddef>
#include <vector>

namespace tarsier::sfm {

constexpr int kShownPoints = 8;

// Sets the images' features to the projections of the same eight points around `center`, by their
// current poses.
inline void show_points(Model& model, const Eigen::Vector3d& center, double size) {
  model.cameras = {{.width = 640, .height = 480, .fx = 600, .fy = 600, .cx = 320, .cy = 240}};
  for (Image& image : model.images) {
    image.features.clear();
    for (int k = 0; k < kShownPoints; ++k) {
      const Eigen::Vector3d offset(0.3 * k - 1, k % 2 == 0 ? 0.9 : -1.1, 0.25 * ((3 * k) % 8) - 1);
      const Eigen::Vector3d seen = image.pose * (center + size * offset);
      image.features.emplace_back(static_cast<float>(600 * seen.x() / seen.z() + 320),
                                  static_cast<float>(600 * seen.y() / seen.z() + 240));
    }
  }
}

// `count` matches of these points. Each is shifted by `shift` in the second image; 0: correct
// matches.
inline std::vector<Match> shown_matches(std::size_t count, int shift = 0) {
  std::vector<Match> matches;
  for (std::size_t k = 0; k < count; ++k) {
    const int point = static_cast<int>(k) % kShownPoints;
    matches.push_back({point, (point + shift) % kShownPoints});
  }
  return matches;
}

}  // namespace tarsier::sfm
