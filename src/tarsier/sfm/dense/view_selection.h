// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/sfm/dense/patch_match.h"
#include "tarsier/sfm/scene/model.h"

#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

struct ViewSelectionOptions {
  int views = 6;               // max sources per image
  double good_angle_deg = 9;   // between the rays of two images; other angles have less weight
  double min_angle_deg = 0.5;  // below, depth cannot be measured
  double max_angle_deg = 60;   // above, patches are too different
  int min_shared_points = 5;   // min common points of two images
  double depth_margin = 0.5;   // relative extension of the range of known depths, at both ends

  [[nodiscard]] OptionFields fields() {
    return {{"views", views, range(1, 16), "--views", "number of source images for each depth map"},
            {"good_angle_deg", good_angle_deg, inside(0, 90)},
            {"min_angle_deg", min_angle_deg, range(0, 45)},
            {"max_angle_deg", max_angle_deg, inside(0, 180)},
            {"min_shared_points", min_shared_points, range(1, 1000)},
            {"depth_margin", depth_margin, range_below(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

// The sources of an image, and its depth range.
struct ViewChoice {
  struct Source {
    int image = 0;  // index into Model::images
    double score = 0;
    int shared = 0;        // number of points
    double angle_deg = 0;  // median over the common points, accurate to 0.25 degrees
  };
  std::vector<Source> sources;  // best first; may be empty
  double min_depth = 0;         // world units, z; 0 where no point is known
  double max_depth = 0;
  std::vector<KnownDepth> known;  // the points of the image, px of its camera
  std::string reason;             // why it has no sources, or ""
};

// Chooses the sources for each image of the model. All images are registered and undistorted. Two
// images share the points that both see. The weight of a point depends on the angle a between its
// rays and on the ratio r >= 1 of its sizes in the images (after Goesele and others, ICCV 2007; Yao
// and others, ECCV 2018):
//   exp(-(a - good)^2 / (2 s^2)) / r^2, s = good / 2 below and 1.5 good above the good angle.
// The points of each of 12 x 12 parts of the image count by the square root of their sum, so that
// overlap matters more than texture. A source next to one already chosen counts half, since other
// angles give more information. The depth range is the 1st to 99th percentile of the known inverse
// depths, with a margin. Of a point in more than 40 images, each image is paired with the 40 next
// ones of the track. Throws Interrupted.
[[nodiscard]] std::vector<ViewChoice> select_views(const Model& model,
                                                   const ViewSelectionOptions& options,
                                                   const std::stop_token& stop = {});

}  // namespace tarsier::sfm
