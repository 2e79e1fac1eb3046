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
  int views = 6;               // sources of an image, at most
  double good_angle_deg = 9;   // between the rays of two images; less or more counts less
  double min_angle_deg = 0.5;  // below there is no depth to see
  double max_angle_deg = 60;   // beyond patches do not look alike
  int min_shared_points = 5;   // of two images
  double depth_margin = 0.5;   // beyond the known depths, of the nearest and the farthest

  [[nodiscard]] OptionFields fields() {
    return {{"views", views, range(1, 16), "--views", "images that each image is compared with"},
            {"good_angle_deg", good_angle_deg, inside(0, 90)},
            {"min_angle_deg", min_angle_deg, range(0, 45)},
            {"max_angle_deg", max_angle_deg, inside(0, 180)},
            {"min_shared_points", min_shared_points, range(1, 1000)},
            {"depth_margin", depth_margin, range_below(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

// What an image is compared with, and how far what it sees may be.
struct ViewChoice {
  struct Source {
    int image = 0;  // index into Model::images
    double score = 0;
    int shared = 0;        // points
    double angle_deg = 0;  // median over the shared points, to 0.25 degrees
  };
  std::vector<Source> sources;  // the best first; empty where there is none
  double min_depth = 0;         // world units, z; 0 where no point is known
  double max_depth = 0;
  std::vector<KnownDepth> known;  // the points of the image, px of its camera
  std::string reason;             // why it has no sources, or ""
};

// Of each image of the model, which are all registered and not distorted. Two images share the points
// that both see. A point counts by the angle a at which their rays meet and by how much larger
// it is in one of them, r >= 1 (after Goesele and others, ICCV 2007; Yao and others, ECCV 2018):
//   exp(-(a - good)^2 / (2 s^2)) / r^2, s = good / 2 below and 1.5 good above the good angle;
// the points of each of 12 x 12 parts of the image as the square root of their sum, so that
// overlap counts and not how much texture is there. A source that is next to one that was chosen
// counts half: other angles tell more. Depths are the 1st to 99th hundredth of the known ones, by
// their inverse, with a margin.
// Of a point that more than 40 images see, each is paired with the 40 that follow it in the track. Throws
// Interrupted.
[[nodiscard]] std::vector<ViewChoice> select_views(const Model& model,
                                                   const ViewSelectionOptions& options,
                                                   const std::stop_token& stop = {});

}  // namespace tarsier::sfm
