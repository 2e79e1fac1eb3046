// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/planar/image_targets/homography_fit.h"
#include "tarsier/planar/image_targets/target.h"

#include <vector>

namespace tarsier::planar::image_targets {

// Moves a guess of where the target is to a small part of a pixel: patches of the image are drawn
// as the guess would show them, each is shifted to where it fits best (inverse compositional
// Lucas-Kanade with gain and offset: Baker and Matthews, IJCV 2004), and the homography is fitted
// to the shifts, robustly; from coarse to fine levels.
struct AlignOptions {
  int coarsest_side = 40;  // px of the target on the coarsest level
  int finest_level = 0;    // of the frame's whole octaves: 1 stops at half the resolution
  int coarse_patches = 40;
  int fine_patches = 90;
  int rounds = 2;           // of shifting and fitting on each level
  double good_match = 0.6;  // min correlation of a patch that fits

  [[nodiscard]] OptionFields fields() {
    return {{"coarsest_side", coarsest_side, range(16, 1000)},
            {"finest_level", finest_level, range(0, 8)},
            {"coarse_patches", coarse_patches, range(8, 200)},
            {"fine_patches", fine_patches, range(8, 200)},
            {"rounds", rounds, range(1, 10)},
            {"good_match", good_match, range(0, 1)}};
  }
  void check() const { check_fields(*this); }  // throws std::invalid_argument
};

struct LevelReport {
  int level = 0;       // of the frame's pyramid
  int visible = 0;     // patches inside the frame
  int good = 0;        // of these, shifted to a place that fits and agrees with the others
  double covered = 0;  // part of the image that the good ones surround
};

struct Alignment {
  cv::Matx33d h;                    // px of the frame from px of the image
  std::vector<Sighting> sightings;  // good ones of the finest level
  std::vector<LevelReport> levels;  // coarse to fine
  std::size_t standing = 0;         // the level whose word stands, mostly the finest
  double rms_px = 0;                // of the sightings
  double deviation_px = 0;          // of the least certain corner, see corner_deviation()
  double side_px = 0;               // root of the area of the target in the frame
};

// `frame`: a pyramid of the frame; of its levels only 0, 2, 4 .. are used. Throws
// std::invalid_argument for bad options.
[[nodiscard]] Alignment align(const Target& target, const Pyramid& frame, const cv::Matx33d& start,
                              const AlignOptions& options);

}  // namespace tarsier::planar::image_targets
