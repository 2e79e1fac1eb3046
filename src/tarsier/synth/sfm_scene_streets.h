// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/synth/sfm_scene_solids.h"
#include "tarsier/synth/sfm_scene_texture.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <cstdint>
#include <vector>

// The streets and houses of sfm_scene.h. Internal to this module.
namespace tarsier::synth {

// Unique colours for each `key` from one shared texture: blends two places of the texture that
// depend on `key`, one of them rotated by 90 degrees. `width` and `height`: of the texture, units.
[[nodiscard]] cv::Vec3f patchwork(const Texture& texture, double width, double height,
                                  std::uint64_t key, double u, double v, double footprint);

// The appearance of a house. Equal values give equal appearances.
struct House {
  std::uint64_t design = 0;
  double window_pitch[2] = {};  // units between windows, across and up
  double window_half[2] = {};   // units
  float frame = 0;              // grey level
  bool has_windows = true;
};

struct Streets {
  std::vector<Solid> solids;          // houses, and the bays on their fronts
  std::vector<House> houses;          // one for each solid
  std::vector<Eigen::Vector2d> path;  // of the cameras
};

// `repeats`: share of the houses that look like others, 0..1.
[[nodiscard]] Streets make_walk(int images, double repeats, Rng rng);  // along a winding street
[[nodiscard]] Streets make_city(int images, double repeats,
                                Rng rng);  // all streets of square blocks
// Houses without windows over a region of the ground, on half of the positions of a grid.
[[nodiscard]] Streets make_village(const cv::Rect2d& region, Rng rng);

// Colour at a point of a house's face, in noon light.
[[nodiscard]] cv::Vec3f house_colour(const House& house, const Solid& solid, int face,
                                     const Eigen::Vector3d& local, const Texture& texture,
                                     double width, double height, double footprint);

}  // namespace tarsier::synth
