// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/at.h"
#include "tarsier/sfm/consistency/testing_shown_points.h"
#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <cstddef>
#include <vector>

namespace tarsier::sfm {

// Images in a row with a distance of 1.
inline Model row_of_images(int images) {
  Model model;
  model.images.resize(at(images));
  for (int i = 0; i < images; ++i) {
    Image& image = model.images[at(i)];
    image.registered = true;
    image.pose.translation = {-static_cast<double>(i), 0, 0};
  }
  show_points(model, {images / 2.0, 0, 8}, 4);
  return model;
}

// The row, with the images from `begin` on at another place.
inline Model misplaced_row(int images, int begin) {
  Model model = row_of_images(images);
  const geometry::Rigid3 motion{geometry::rotation_by({0, 1, 0}), {4, 0, 9}};
  for (int i = begin; i < images; ++i) model.images[at(i)].pose = model.images[at(i)].pose * motion;
  return model;
}

// A pair with the relative pose of the model.
inline Pair pair_of_poses(const Model& model, int first, int second, std::size_t inliers) {
  Pair pair;
  pair.first = first;
  pair.second = second;
  pair.view.inliers = shown_matches(inliers);
  pair.view.median_angle = 0.1;
  pair.view.second_from_first =
      model.images[at(second)].pose * model.images[at(first)].pose.inverse();
  return pair;
}

// The pairs of each image of the row with the next two, of 100 and 80 inliers.
inline std::vector<Pair> pairs_of_row(int images) {
  const Model model = row_of_images(images);
  std::vector<Pair> pairs;
  for (int i = 0; i + 1 < images; ++i) {
    pairs.push_back(pair_of_poses(model, i, i + 1, 100));
    if (i + 2 < images) pairs.push_back(pair_of_poses(model, i, i + 2, 80));
  }
  return pairs;
}

}  // namespace tarsier::sfm
