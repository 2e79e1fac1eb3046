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
  int min_views = 3;                 // images that agree on a point, where so many have it in view
  double max_reprojection_px = 1.5;  // of a pixel of another image
  double max_depth_difference = 0.01;  // of the depth
  double max_normal_angle_deg = 35;

  [[nodiscard]] OptionFields fields() {
    return {{"min_views", min_views, range(1, 17), "--min-views", "images that show a point"},
            {"max_reprojection_px", max_reprojection_px, above(0, 100)},
            {"max_depth_difference", max_depth_difference, above(0, 1)},
            {"max_normal_angle_deg", max_normal_angle_deg, above(0, 180)}};
  }
  void check() const { check_fields(*this); }
};

// Joins the geometric depth maps of a workspace to one cloud (after Galliani and others, ICCV 2015, and
// Schoenberger and others, ECCV 2016): a pixel that no earlier point took is carried into its
// neighbours; pixels there whose depth, place and normal agree are taken together, and where they are
// `min_views` images with it their mean, weighted by confidence, is a point. Colours are those of the
// images, in the size of the maps. The confidence of a point is 1 - the product of 1 - c of its pixels.
// Points come image by image, row by row; the same for any number of threads.
//
// `neighbours`: of each image those whose maps are looked at, by index. Images without a map are passed
// over. Maps are read when they are needed, and `memory_bytes` says how much of them is kept (those
// of one image and its neighbours at least). Returns how many points each image began.
// Throws InputError, OutputError, Interrupted; std::invalid_argument.
[[nodiscard]] std::vector<std::int64_t> fuse(const Workspace& workspace,
                                             const std::vector<std::vector<int>>& neighbours,
                                             const FusionOptions& options,
                                             std::int64_t memory_bytes, CloudWriter& cloud,
                                             Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::sfm
