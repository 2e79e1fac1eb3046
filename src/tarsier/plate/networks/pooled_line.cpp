// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/pooled_line.h"

#include "tarsier/core/require.h"
#include "tarsier/plate/networks/networks.h"
#include "tarsier/plate/text/decode.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace tarsier::plate {

float along(int column, int width) {
  const float x = (static_cast<float>(column) + 0.5F) * kColumnStride - 0.5F;
  return (x - kLineMargin) / static_cast<float>(width - 2 * kLineMargin);
}

Quad view_quad(const Quad& text, const TextView& view) {
  return part_of(text, 0.5F - view.along / 2, 0.5F + view.along / 2, 0.5F - view.across / 2,
                 0.5F + view.across / 2);
}

PooledLine::PooledLine(int width)
    : width_(width),
      sum_(width / kColumnStride, kClasses, CV_32F, cv::Scalar(0)),
      view_counts_(static_cast<std::size_t>(width / kColumnStride), 0.0F) {}

void PooledLine::add(const cv::Mat& probabilities, const TextView& view) {
  TARSIER_REQUIRE(probabilities.size() == sum_.size() && probabilities.type() == CV_32F,
                  "{}x{}, type {} for a line of {} columns", probabilities.cols, probabilities.rows,
                  probabilities.type(), sum_.rows);
  constexpr float kFloor = 1e-5F;  // a single view cannot exclude a symbol
  const auto room = static_cast<float>(width_ - 2 * kLineMargin);
  for (int column = 0; column < sum_.rows; ++column) {
    const float position = 0.5F + (along(column, width_) - 0.5F) / view.along;
    const float at = (position * room + kLineMargin + 0.5F) / kColumnStride - 0.5F;
    constexpr float kRounding = 1e-3F;
    if (at < -kRounding || at > static_cast<float>(sum_.rows - 1) + kRounding) continue;
    const int left = std::clamp(static_cast<int>(at), 0, sum_.rows - 2);
    const float share = std::clamp(at - static_cast<float>(left), 0.0F, 1.0F);
    const auto* before = probabilities.ptr<float>(left);
    const auto* after = probabilities.ptr<float>(left + 1);
    auto* row = sum_.ptr<float>(column);
    for (int k = 0; k < kClasses; ++k)
      row[k] += std::log(kFloor + (1 - share) * before[k] + share * after[k]);
    view_counts_[static_cast<std::size_t>(column)] += 1;
  }
}

cv::Mat PooledLine::mean() const {
  cv::Mat result = sum_.clone();
  for (int column = 0; column < result.rows; ++column) {
    auto* row = result.ptr<float>(column);
    const float views = std::max(1.0F, view_counts_[static_cast<std::size_t>(column)]);
    const float top = *std::max_element(row, row + kClasses);
    float total = 0;
    for (int k = 0; k < kClasses; ++k) total += row[k] = std::exp((row[k] - top) / views);
    for (int k = 0; k < kClasses; ++k) row[k] /= total;
  }
  return result;
}

}  // namespace tarsier::plate
