// SPDX-License-Identifier: MIT
#include "tarsier/plate/text/reading.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>

namespace tarsier::plate {

int class_of(char symbol) {
  if (symbol >= '0' && symbol <= '9') return symbol - '0';
  if (symbol >= 'A' && symbol <= 'Z') return symbol - 'A' + 10;
  return -1;
}

cv::Rect bounding_box(const Quad& quad, cv::Size size) {
  double left = quad[0].x;
  double right = left;
  double top = quad[0].y;
  double bottom = top;
  for (const cv::Point2f& corner : quad) {
    TARSIER_REQUIRE(std::isfinite(corner.x) && std::isfinite(corner.y), "a corner at {}, {}",
                    corner.x, corner.y);
    left = std::min<double>(left, corner.x);
    right = std::max<double>(right, corner.x);
    top = std::min<double>(top, corner.y);
    bottom = std::max<double>(bottom, corner.y);
  }
  // Pixel k covers k - 0.5 to k + 0.5.
  const auto cut = [](double edge, int end) {
    return static_cast<int>(std::clamp<double>(edge, 0, std::max(end, 0)));
  };
  const cv::Point first{cut(std::floor(left + 0.5), size.width),
                        cut(std::floor(top + 0.5), size.height)};
  const cv::Point end{cut(std::ceil(right + 0.5), size.width),
                      cut(std::ceil(bottom + 0.5), size.height)};
  return {first, end};
}

}  // namespace tarsier::plate
