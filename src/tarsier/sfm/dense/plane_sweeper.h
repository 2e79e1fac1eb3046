// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/dense/plane_field.h"

#include <array>
#include <cstdint>
#include <stop_token>

namespace tarsier::sfm {

// One scale of PatchMatch (patch_match.h): better planes for the pixels of a field. Where the level has
// larger images, patches with enough texture for it are looked at there and 0.4 times as wide (0.6, where
// the images are not larger): a patch that is wider than the relief sees its mean. Internal to this
// module. Same field, level and seed, same result for any number of threads: a pixel looks only at
// pixels of the other colour of a checkerboard, and its random numbers come from its place.
class PlaneSweeper {
 public:
  struct Options {
    int best_views = 3;             // sources that decide for a pixel
    float geometric_weight = 0.2F;  // cost of a px of reprojection, of sources that have depths
    std::uint64_t seed = 0;
  };
  // `level` and `field`, which has its size, must outlive this.
  PlaneSweeper(const MatchLevel& level, PlaneField& field, const Options& options);

  // The costs of the planes that the field has; those out of the range of depths come into it.
  void score(const std::stop_token& stop);
  // Each pixel tries `count` planes at random depths, besides its own.
  void try_random(int count, const std::stop_token& stop);
  // Each pixel tries the planes of eight pixels around it and `changes` changes of its own, of up to
  // `motion` px in the sources; half of the pixels after the other half.
  void sweep(int round, float motion, int changes, const std::stop_token& stop);
  // The minimum of the cost along the ray: of the parabola through three planes `step` px apart.
  void refine(float step, const std::stop_token& stop);

 private:
  struct Views {
    int count = 0;
    std::array<int, kMaxSources> source{};
    std::array<float, kMaxSources> weight{};  // sum 1
  };
  struct Pixel;  // what is known of the pixel that is looked at
  class Random;

  void look(int x, int y, Pixel& pixel) const;
  void choose_views(Pixel& pixel) const;
  [[nodiscard]] float view_cost(const Pixel& pixel, int source, const Plane& plane) const;
  [[nodiscard]] float geometric_cost(const Pixel& pixel, const SourceLevel& source,
                                     const std::array<float, 3>& base, float inverse_depth) const;
  [[nodiscard]] bool is_possible(const Pixel& pixel, const Plane& plane) const;
  bool consider(Pixel& pixel, const Plane& plane) const;
  void keep(const Pixel& pixel);
  void propagate(Pixel& pixel) const;
  void change(Pixel& pixel, float motion, int changes, int round) const;
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
