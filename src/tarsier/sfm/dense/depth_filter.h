// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/sfm/dense/depth_map.h"
#include "tarsier/sfm/dense/patch_match.h"

#include <opencv2/core.hpp>

#include <vector>

namespace tarsier::sfm {

struct DepthFilterOptions {
  double max_cost = 0.6;               // of a plane (patch_match.h); 0: the images are the same
  int min_consistent = 2;              // sources whose depths agree, where so many have it in view
  double max_reprojection_px = 1;      // carried to the source and back
  double max_depth_difference = 0.01;  // of the depth
  int min_segment_px = 40;             // smaller islands of depth go

  [[nodiscard]] OptionFields fields() {
    return {{"max_cost", max_cost, range(0, 2)},
            {"min_consistent", min_consistent, range(0, 16), "--min-consistent",
             "other images whose depths must agree"},
            {"max_reprojection_px", max_reprojection_px, above(0, 100)},
            {"max_depth_difference", max_depth_difference, above(0, 1)},
            {"min_segment_px", min_segment_px, range(0, 1e9)}};
  }
  void check() const { check_fields(*this); }
};

// What of a map of planes is right, by its cost and by what the sources say (their `depth`; those
// without have no say): a pixel stays where `min_consistent` of them agree. Where fewer
// have its point in their image, all of these must agree, and half the cost is allowed. The confidence is
// (1 - cost)(1 - 2^-n), n how many agree, 0 at least. `problem` is the one of the map.
[[nodiscard]] DepthMap filtered(const MatchProblem& problem, const PlaneMap& map,
                                const DepthFilterOptions& options);

// Takes away islands of fewer px, in which depths of neighbours differ by `difference` of the depth at
// most; all three maps of them become 0.
void remove_small_segments(DepthMap& map, int min_px, double difference);

}  // namespace tarsier::sfm
