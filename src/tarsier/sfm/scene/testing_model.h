// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/sfm/scene/model.h"

#include <Eigen/Core>
#include <fmt/format.h>

#include <cmath>

namespace tarsier::sfm {

// A model for tests: a wall of points seen by five images of three cameras. One image is not
// registered. Some features belong to no point.
[[nodiscard]] inline Model synthetic_model() {
  Rng rng(7);
  Model model;
  model.cameras.resize(3);
  model.cameras[0] = {640, 480, 500.25, 501.75, 319.5, 239.5, {}, 0};
  model.cameras[1] = {640, 480, 1.0 / 3 * 1600, 530, 320.125, 241, {-0.1, 0.02, 1e-3, -2e-3, 0}, 0};
  model.cameras[2] = {800, 600, 700, 700, 400, 300, {-0.1, 0.02, 0, 0, 1.0 / 70}, 0.25};
  for (int i = 0; i < 5; ++i) {
    Image image;
    image.name = fmt::format("folder/photo {}.jpg", i);
    image.camera = i % 3;
    image.registered = i != 1;
    const Eigen::Vector4d q(1, rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1),
                            rng.uniform(-0.1, 0.1));
    image.pose = {geometry::rotation_of(q), {rng.uniform(-1, 1), rng.uniform(-1, 1), 0.1 * i}};
    model.images.push_back(image);
  }
  for (int p = 0; p < 100; ++p) {
    Point point;
    point.position = {rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(6, 8)};
    for (int k = 0; k < 3; ++k) point.color[k] = static_cast<unsigned char>(rng.integer(0, 255));
    point.error = rng.uniform();
    for (int i = 0; i < 5; ++i) {
      Image& image = model.images[static_cast<std::size_t>(i)];
      const bool is_seen = image.registered && (i < 3 || rng.uniform() < 0.5);
      const auto pixel = model.cameras[static_cast<std::size_t>(image.camera)].project(
          image.pose * point.position);
      if (rng.uniform() < 0.2) {
        image.features.emplace_back(static_cast<float>(rng.uniform(0, 640)), 7.F);
        image.points.push_back(-1);
      }
      if (!is_seen || !pixel) continue;
      point.track.push_back({i, static_cast<int>(image.features.size())});
      image.features.emplace_back(static_cast<float>(pixel->x), static_cast<float>(pixel->y));
      image.points.push_back(p);
    }
    model.points.push_back(point);
  }
  return model;
}

}  // namespace tarsier::sfm
