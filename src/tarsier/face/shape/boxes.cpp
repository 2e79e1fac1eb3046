// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/face/shape/import.h"

#include <cmath>
#include <map>
#include <set>
#include <vector>

namespace tarsier::face::shape {

std::vector<BoxedImage> boxes_from_landmarks(const LandmarkSet& set, double sides) {
  TARSIER_REQUIRE(sides >= 1 && sides <= 10, "sides {}", sides);
  set.check();
  std::vector<BoxedImage> images;
  std::map<std::string, std::size_t> index_of_image;
  std::set<std::string> unclear;  // images with an object at an unknown position
  for (const LandmarkSample& sample : set.samples) {
    const auto [found, is_new] = index_of_image.try_emplace(sample.image, images.size());
    if (is_new) images.push_back({sample.image, {}, {}, {}});
    BoxedImage& image = images[found->second];
    Eigen::Vector2d center = Eigen::Vector2d::Zero();
    double size = 0;  // a set may have no points yet
    if (sample.points.cols() > 0) {
      center = sample.points.rowwise().mean();
      size = std::sqrt((sample.points.colwise() - center).colwise().squaredNorm().mean());
    }
    if (!sample.is_complete() || !(size > 0)) {
      if (sample.box) {
        image.ignored.push_back(*sample.box);
      } else {
        unclear.insert(sample.image);
      }
      continue;
    }
    const double side = sides * size;
    // Pixel centres are at integers: a box from x covers the pixels from x - 0.5 on.
    image.boxes.emplace_back(center.x() + 0.5 - side / 2, center.y() + 0.5 - side / 2, side, side);
    image.shapes.push_back(sample.points);
  }
  std::erase_if(images, [&](const BoxedImage& p) { return unclear.contains(p.image); });
  return images;
}

}  // namespace tarsier::face::shape
