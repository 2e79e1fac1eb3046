// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/sfm/dense/cloud.h"
#include "tarsier/sfm/dense/workspace.h"

#include <cstdint>
#include <stop_token>
#include <vector>

namespace tarsier::sfm {

struct FusionOptions {
  int min_views = 3;                   // min images that agree on a point, where that many see it
  double max_reprojection_px = 1.5;    // max error in the other image
  double max_depth_difference = 0.01;  // share of the depth
  double max_normal_angle_deg = 35;

  [[nodiscard]] OptionFields fields() {
    return {{"min_views", min_views, range(1, 17), "--min-views",
             "minimum number of images that observe a point"},
            {"max_reprojection_px", max_reprojection_px, above(0, 100)},
            {"max_depth_difference", max_depth_difference, above(0, 1)},
            {"max_normal_angle_deg", max_normal_angle_deg, above(0, 180)}};
  }
  void check() const { check_fields(*this); }
};

// Fuses the geometric depth maps of a workspace into one cloud (after Galliani and others, ICCV
// 2015, and Schoenberger and others, ECCV 2016). A pixel that is not part of an earlier point is
// projected into the neighbours. Pixels there with consistent depth, position and normal are
// collected. Where they come from `min_views` images, including the first, their mean, weighted by
// confidence, is a point. Colours are those of the images, in the size of the maps. The confidence
// of a point is 1 minus the product of 1 - c of its pixels. Points are written image by image, row
// by row. The result does not depend on the number of threads.
//
// `neighbours`: for each image the images whose maps are compared, by index. Images without a map
// are skipped. Maps are read when needed. `memory_bytes` limits the maps kept in memory; those of
// one image and its neighbours are always kept. Returns the number of points that started in each
// image. Throws InputError, OutputError, Interrupted; std::invalid_argument.
[[nodiscard]] std::vector<std::int64_t> fuse(const Workspace& workspace,
                                             const std::vector<std::vector<int>>& neighbours,
                                             const FusionOptions& options,
                                             std::int64_t memory_bytes, CloudWriter& cloud,
                                             Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::sfm
