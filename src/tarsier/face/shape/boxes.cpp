// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/face/shape/import.h"

#include <cmath>
#include <map>
#include <set>
#include <vector>

namespace tarsier::face::shape {

std::vector<BoxedPicture> boxes_from_landmarks(const LandmarkSet& set, double sides) {
  TARSIER_REQUIRE(sides >= 1 && sides <= 10, "sides {}", sides);
  set.check();
  std::vector<BoxedPicture> pictures;
  std::map<std::string, std::size_t> place;
  std::set<std::string> unclear;  // an object somewhere in it, nobody knows where
  for (const LandmarkSample& sample : set.samples) {
    const auto [found, is_new] = place.try_emplace(sample.image, pictures.size());
    if (is_new) pictures.push_back({sample.image, {}, {}, {}});
    BoxedPicture& picture = pictures[found->second];
    Eigen::Vector2d center = Eigen::Vector2d::Zero();
    double size = 0;  // a set may have no points yet
    if (sample.points.cols() > 0) {
      center = sample.points.rowwise().mean();
      size = std::sqrt((sample.points.colwise() - center).colwise().squaredNorm().mean());
    }
    if (!sample.is_complete() || !(size > 0)) {
      if (sample.box) {
        picture.ignored.push_back(*sample.box);
      } else {
        unclear.insert(sample.image);
      }
      continue;
    }
    const double side = sides * size;
    // Pixel centres are at integers: a box from x covers the pixels from x - 0.5 on.
    picture.boxes.emplace_back(center.x() + 0.5 - side / 2, center.y() + 0.5 - side / 2, side,
                               side);
    picture.shapes.push_back(sample.points);
  }
  std::erase_if(pictures, [&](const BoxedPicture& p) { return unclear.contains(p.image); });
  return pictures;
}

}  // namespace tarsier::face::shape
