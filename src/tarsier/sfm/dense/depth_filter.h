// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/sfm/dense/depth_map.h"
#include "tarsier/sfm/dense/patch_match.h"

#include <opencv2/core.hpp>

#include <vector>

namespace tarsier::sfm {

struct DepthFilterOptions {
  double max_cost = 0.6;           // max cost of a plane (patch_match.h); 0: equal images
  int min_consistent = 2;          // min sources whose depths agree, where that many see the point
  double max_reprojection_px = 1;  // after projection to the source and back
  double max_depth_difference = 0.01;  // share of the depth
  int min_segment_px = 40;             // smaller segments of depth are removed

  [[nodiscard]] OptionFields fields() {
    return {{"max_cost", max_cost, range(0, 2)},
            {"min_consistent", min_consistent, range(0, 16), "--min-consistent",
             "minimum number of other images with consistent depth"},
            {"max_reprojection_px", max_reprojection_px, above(0, 100)},
            {"max_depth_difference", max_depth_difference, above(0, 1)},
            {"min_segment_px", min_segment_px, range(0, 1e9)}};
  }
  void check() const { check_fields(*this); }
};

// Filters a map of planes by cost and by the depths of the sources. Sources without `depth` are
// ignored. A pixel is kept where `min_consistent` sources agree. Where fewer have its point in
// their image, all of these must agree, and only half the cost is allowed. The confidence is (1 -
// cost)(1 - 2^-n), at least 0, for n agreeing sources. `problem` is the one of the map.
[[nodiscard]] DepthMap filtered(const MatchProblem& problem, const PlaneMap& map,
                                const DepthFilterOptions& options);

// Removes connected segments of fewer than `min_px` pixels, in which neighbouring depths differ by
// at most `difference` of the depth. All three maps become 0 there.
void remove_small_segments(DepthMap& map, int min_px, double difference);

}  // namespace tarsier::sfm
