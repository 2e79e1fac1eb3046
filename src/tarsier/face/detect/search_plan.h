// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/types.hpp>

#include <vector>

// A search of a large image in many small ones, so that a video can spread it over its frames.
namespace tarsier::face {

// A part of an image, and the widths of faces to look for there.
struct SearchTile {
  cv::Rect area;        // px
  double min_face = 0;  // px
  double max_face = 0;  // px; 0: as large as the part
  bool operator==(const SearchTile&) const = default;
};

struct SearchPlan {
  // The whole image, for the large faces, in one go.
  SearchTile whole;
  // The parts for the smaller ones, small faces first. A face lies in one of them at least with a
  // margin of a quarter of its width. Empty where `whole` looks for all sizes.
  std::vector<SearchTile> tiles;
};

// For faces from `min_face` px on, by a detector whose smallest face is `window` px (it reduces or
// enlarges what it is given accordingly). No part has a longer side than `tile` px there, so that
// a tile costs about the same whatever the image's size is; tile >= 8 window.
[[nodiscard]] SearchPlan plan_search(cv::Size image, double min_face, double window,
                                     double tile = 320);

}  // namespace tarsier::face
