// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <cstdint>

namespace tarsier::sfm {

enum class MapperChoice {
  kIncremental,  // an initial pair, then one image after the other
  kGlobal,  // all images together (global_start.h), then the remaining ones one after the other
  // global for sets of at least auto_global images, else incremental; also where global is refused
  kAuto,
};

struct MapperOptions {
  MapperChoice choice = MapperChoice::kIncremental;
  int auto_global = 250;           // connected images
  double reprojection_px = 1.5;    // max reprojection error of an observation
  double min_angle_deg = 1.5;      // min angle between two rays of a point
  double first_angle_deg = 4;      // min median angle of the initial pair
  int first_inliers = 60;          // min inliers of the initial pair
  int pose_inliers = 16;           // min inliers of an added image
  double pose_inlier_share = 0.2;  // min share of the points that the image should see
  double pose_px = 4;              // max reprojection error of an inlier of a new pose
  // Min images that show a point of the result. A point of two images cannot be checked by a third
  // one. Models of fewer than four images keep such points.
  int min_views = 3;
  int min_images = 2;  // min images of a model
  // search radius around the projection of a known point; 0 disables the search
  double extend_px = 3;
  double extend_similarity = 0.75;  // min similarity to the point's other descriptors
  bool refine_focal = false;
  bool refine_center = false;
  bool refine_distortion = false;
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"auto_global", auto_global, range(3, 1'000'000)},
            {"reprojection_px", reprojection_px, range(0.1, 50), "--reprojection-px",
             "px, maximum reprojection error of an observation"},
            {"min_angle_deg", min_angle_deg, range(0.01, 30), "--min-angle",
             "minimum angle between the rays of a point, degrees"},
            {"first_angle_deg", first_angle_deg, range(0.1, 60)},
            {"first_inliers", first_inliers, range(16, 100'000)},
            {"pose_inliers", pose_inliers, range(6, 100'000)},
            {"pose_inlier_share", pose_inlier_share, range(0, 1)},
            {"pose_px", pose_px, range(0.1, 50)},
            {"min_views", min_views, range(2, 100), "--min-views",
             "minimum number of images that observe a point"},
            {"min_images", min_images, range(2, 1000)},
            {"extend_px", extend_px, at_least(0)},
            {"extend_similarity", extend_similarity, range(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

}  // namespace tarsier::sfm
