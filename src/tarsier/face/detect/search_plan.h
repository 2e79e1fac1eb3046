// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/types.hpp>

#include <vector>

// Divides the search of a large image into many small ones, so that a video can spread it over its
// frames.
namespace tarsier::face {

// A part of an image, and the widths of faces to search for in it.
struct SearchTile {
  cv::Rect area;        // px
  double min_face = 0;  // px
  double max_face = 0;  // px; 0: as large as the part
  bool operator==(const SearchTile&) const = default;
};

struct SearchPlan {
  // The whole image, for large faces, in one search.
  SearchTile whole;
  // The parts for smaller faces, smallest faces first. Each face is inside at least one part, with
  // a margin of a quarter of its width. Empty if `whole` covers all sizes.
  std::vector<SearchTile> tiles;
};

// For faces from `min_face` px on, and a detector whose smallest face is `window` px (parts are
// scaled accordingly). After scaling, no part has a side longer than `tile` px, so that a tile
// costs about the same for any image size; tile >= 8 window.
[[nodiscard]] SearchPlan plan_search(cv::Size image, double min_face, double window,
                                     double tile = 320);

}  // namespace tarsier::face
