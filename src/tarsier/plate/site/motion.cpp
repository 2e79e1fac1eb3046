// SPDX-License-Identifier: MIT
#include "tarsier/plate/site/motion.h"

#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

namespace tarsier::plate {
namespace {

constexpr int kCellColumns = 160;  // cells

cv::Mat cells_of(const cv::Mat& image) {
  const int width = std::min(kCellColumns, image.cols);
  const int height = std::max(1, cvRound(static_cast<double>(image.rows) * width / image.cols));
  cv::Mat small;
  cv::resize(image, small, {width, height}, 0, 0, cv::INTER_AREA);
  if (small.channels() == 3) cv::cvtColor(small, small, cv::COLOR_BGR2GRAY);
  cv::Mat cells;
  small.convertTo(cells, CV_32F);
  return cells;
}

float median_of(const cv::Mat& values) {
  return upper_median(std::vector<float>(values.begin<float>(), values.end<float>()));
}

}  // namespace

bool has_motion(const MotionOptions& options, MotionState& state, const cv::Mat& image,
                double time) {
  TARSIER_REQUIRE(!image.empty() && (image.type() == CV_8UC3 || image.type() == CV_8UC1),
                  "the image is 8-bit BGR or grey");
  if (options.threshold <= 0) return true;
  const cv::Mat cells = cells_of(image);
  if (state.background.size() != cells.size()) {
    state.background = cells;
    state.last_change_time = cv::Mat(cells.size(), CV_64F, cv::Scalar(time));
    return true;
  }
  cv::Mat change = cells - state.background;
  const float global_change = median_of(change);
  int count = 0;
  for (auto it = change.begin<float>(); it != change.end<float>(); ++it)
    count += std::abs(*it - global_change) > options.threshold ? 1 : 0;
  const bool moves = count >= options.min_cells;
  for (int y = 0; y < cells.rows; ++y) {
    auto* background = state.background.ptr<float>(y);
    const auto* row = change.ptr<float>(y);
    auto* last_change_time = state.last_change_time.ptr<double>(y);
    for (int x = 0; x < cells.cols; ++x) {
      const bool is_changed = std::abs(row[x] - global_change) > options.threshold;
      background[x] +=
          static_cast<float>(is_changed ? options.learning_moving : options.learning) * row[x];
      if (is_changed) last_change_time[x] = time;
    }
  }
  return moves;
}

cv::Rect motion_box(const MotionState& state, double since, cv::Size size) {
  const cv::Rect whole({0, 0}, size);
  if (state.last_change_time.empty()) return whole;
  constexpr int kMargin = kCellColumns / 40;  // cells
  const cv::Rect cells = cv::boundingRect(state.last_change_time >= since);
  if (cells.empty()) return {};
  const double across = static_cast<double>(size.width) / state.last_change_time.cols;
  const double down = static_cast<double>(size.height) / state.last_change_time.rows;
  const cv::Point first(cvFloor((cells.x - kMargin) * across), cvFloor((cells.y - kMargin) * down));
  const cv::Point last(cvCeil((cells.br().x + kMargin) * across),
                       cvCeil((cells.br().y + kMargin) * down));
  return cv::Rect(first, last) & whole;
}

}  // namespace tarsier::plate
