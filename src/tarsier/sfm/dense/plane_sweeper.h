// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/dense/plane_field.h"

#include <array>
#include <cstdint>
#include <stop_token>

namespace tarsier::sfm {

// One scale of PatchMatch (patch_match.h): improves the planes of a field. Where the level has
// larger images, patches with enough texture are compared there with 0.4 times the width (0.6 where
// the images are not larger), since a patch wider than the relief sees its mean. Internal to this
// module. The result depends on field, level and seed, not on the number of threads: a pixel only
// reads pixels of the other colour of a checkerboard, and its random numbers depend on its
// position.
class PlaneSweeper {
 public:
  struct Options {
    int best_views = 3;             // number of sources that are used for a pixel
    float geometric_weight = 0.2F;  // cost per px of reprojection error, for sources with depths
    std::uint64_t seed = 0;
  };
  // `level` and `field`, which has the level's size, must outlive this object.
  PlaneSweeper(const MatchLevel& level, PlaneField& field, const Options& options);

  // Computes the costs of the field's planes; depths are clamped to the range.
  void score(const std::stop_token& stop);
  // Each pixel tries `count` planes at random depths, besides its own.
  void try_random(int count, const std::stop_token& stop);
  // Each pixel tries the planes of eight surrounding pixels and `changes` changes of its own, of up
  // to `motion` px in the sources; first one half of the pixels, then the other.
  void sweep(int round, float motion, int changes, const std::stop_token& stop);
  // Moves each plane to the minimum of the cost along the ray: the parabola through three planes
  // `step` px apart.
  void refine(float step, const std::stop_token& stop);

 private:
  struct Views {
    int count = 0;
    std::array<int, kMaxSources> source{};
    std::array<float, kMaxSources> weight{};  // sum 1
  };
  struct Pixel;  // data of the current pixel
  class Random;

  void load_pixel(int x, int y, Pixel& pixel) const;
  void choose_views(Pixel& pixel) const;
  [[nodiscard]] float view_cost(const Pixel& pixel, int source, const Plane& plane) const;
  [[nodiscard]] float geometric_cost(const Pixel& pixel, const SourceLevel& source,
                                     const std::array<float, 3>& base, float inverse_depth) const;
  [[nodiscard]] bool is_valid(const Pixel& pixel, const Plane& plane) const;
  bool try_plane(Pixel& pixel, const Plane& plane) const;
  void store(const Pixel& pixel);
  void propagate(Pixel& pixel) const;
  void perturb(Pixel& pixel, float motion, int changes, int round) const;
  [[nodiscard]] Plane random_plane(const Pixel& pixel, Random& random) const;
  [[nodiscard]] float motion_of(const Pixel& pixel) const;
  template <typename Work>
  void each_pixel(int colour, const std::stop_token& stop, const Work& work);

  const MatchLevel& level_;
  PlaneField& field_;
  const Options options_;
  const PatchKernels& kernels_;
  const GrayImage gray_;
};

}  // namespace tarsier::sfm
