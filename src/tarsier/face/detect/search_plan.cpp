// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/search_plan.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>

namespace tarsier::face {
namespace {

// Start positions of parts of `part` px that cover `length`; adjacent ones share `shared` px.
std::vector<int> tile_starts(int length, int part, int shared) {
  if (length <= part) return {0};
  const int steps = (length - shared + part - shared - 1) / (part - shared);
  std::vector<int> starts;
  starts.reserve(steps);
  for (int i = 0; i < steps; ++i) {
    starts.push_back(static_cast<int>(static_cast<long>(length - part) * i / (steps - 1)));
  }
  return starts;
}

}  // namespace

SearchPlan plan_search(cv::Size image, double min_face, double window, double tile) {
  TARSIER_REQUIRE(image.width > 0 && image.height > 0, "{}x{}", image.width, image.height);
  TARSIER_REQUIRE(min_face > 0 && window > 0 && tile >= 8 * window, "{} px, {}, {}", min_face,
                  window, tile);
  constexpr double kMargin = 1.5;  // share of a part's largest face that adjacent parts share
  SearchPlan plan;
  // One octave of sizes after the other, until one search covers the reduced image.
  double smallest = min_face;
  while (std::max(image.width, image.height) * window / smallest > tile) {
    const double largest = 2 * smallest;
    const int side = static_cast<int>(tile * smallest / window);
    const int shared = static_cast<int>(std::ceil(kMargin * largest));
    for (const int y : tile_starts(image.height, side, shared)) {
      for (const int x : tile_starts(image.width, side, shared)) {
        const cv::Rect area =
            cv::Rect(x, y, side, side) & cv::Rect(0, 0, image.width, image.height);
        plan.tiles.push_back({area, smallest, largest});
      }
    }
    smallest = largest;
  }
  plan.whole = {cv::Rect(0, 0, image.width, image.height), smallest, 0};
  return plan;
}

}  // namespace tarsier::face
