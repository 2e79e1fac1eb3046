// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/planar/image_targets/homography_fit.h"
#include "tarsier/planar/image_targets/target.h"

#include <vector>

namespace tarsier::planar::image_targets {

// Refines an approximate homography of the target to sub-pixel accuracy. Patches of the target are
// warped by the current estimate. Each patch is shifted to its best match in the frame (inverse
// compositional Lucas-Kanade with gain and offset: Baker and Matthews, IJCV 2004). The homography
// is then fitted robustly to the shifts, from coarse to fine levels.
struct AlignOptions {
  int coarsest_side = 40;  // size of the target on the coarsest level, px
  int finest_level = 0;    // in octaves of the frame: 1 stops at half the resolution
  int coarse_patches = 40;
  int fine_patches = 90;
  int rounds = 2;                // rounds of shifting and fitting on each level
  double min_correlation = 0.6;  // minimum correlation of an inlier patch

  [[nodiscard]] OptionFields fields() {
    return {{"coarsest_side", coarsest_side, range(16, 1000)},
            {"finest_level", finest_level, range(0, 8)},
            {"coarse_patches", coarse_patches, range(8, 200)},
            {"fine_patches", fine_patches, range(8, 200)},
            {"rounds", rounds, range(1, 10)},
            {"good_match", min_correlation, range(0, 1)}};
  }
  void check() const { check_fields(*this); }  // throws std::invalid_argument
};

struct LevelStats {
  int level = 0;        // of the frame's pyramid
  int visible = 0;      // patches inside the frame
  int inliers = 0;      // of these, with a good match that agrees with the others
  double coverage = 0;  // share of the image that the inliers enclose
};

struct Alignment {
  cv::Matx33d h;                                // from px of the image to px of the frame
  std::vector<Correspondence> correspondences;  // the good ones of the finest level
  std::vector<LevelStats> levels;               // coarse to fine
  std::size_t result_level = 0;  // index of the level that gives the result, mostly the finest
  double rms_px = 0;             // rms of the sightings
  double deviation_px = 0;       // of the least certain corner; see corner_deviation()
  double side_px = 0;            // square root of the target's area in the frame
};

// `frame` is a pyramid of the frame; only its levels 0, 2, 4 .. are used. Throws
// std::invalid_argument for bad options.
[[nodiscard]] Alignment align(const Target& target, const Pyramid& frame, const cv::Matx33d& start,
                              const AlignOptions& options);

}  // namespace tarsier::planar::image_targets
