// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/gradient_features.h"

#include "tarsier/core/image.h"
#include "tarsier/core/require.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::face::regression {

namespace {

constexpr float kClip = 0.25F;
constexpr int kMaxCellSide = 41;  // px
constexpr int kBorder = 2;        // px around the cells, for gradients and rounding

using Number = std::uint16_t;

// Gradients of `frame` projected on the eight directions, divided by 2^shift; row by row,
// orientation fastest.
void project(const cv::Mat& frame, int shift, std::vector<Number>& out) {
  const int width = frame.cols;
  const int height = frame.rows;
  out.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * kOrientations);
  for (int y = 0; y < height; ++y) {
    const auto* above = frame.ptr<std::uint8_t>(std::max(0, y - 1));
    const auto* row = frame.ptr<std::uint8_t>(y);
    const auto* below = frame.ptr<std::uint8_t>(std::min(height - 1, y + 1));
    Number* to = out.data() + static_cast<std::ptrdiff_t>(y) * width * kOrientations;
    for (int x = 0; x < width; ++x, to += kOrientations) {
      const int gx = row[std::min(width - 1, x + 1)] - row[std::max(0, x - 1)];
      const int gy = below[x] - above[x];
      // 181 / 256 is the cosine of 45 degrees.
      const int rising = (gx + gy) * 181 / 256;
      const int falling = (gy - gx) * 181 / 256;
      to[0] = static_cast<Number>(std::max(0, gx) >> shift);
      to[1] = static_cast<Number>(std::max(0, rising) >> shift);
      to[2] = static_cast<Number>(std::max(0, gy) >> shift);
      to[3] = static_cast<Number>(std::max(0, falling) >> shift);
      to[4] = static_cast<Number>(std::max(0, -gx) >> shift);
      to[5] = static_cast<Number>(std::max(0, -rising) >> shift);
      to[6] = static_cast<Number>(std::max(0, -gy) >> shift);
      to[7] = static_cast<Number>(std::max(0, -falling) >> shift);
    }
  }
}

// Running sums of `side` (odd) pixels along x, then along y; the border is replicated.
void pool(const std::vector<Number>& map, int width, int height, int side,
          FeatureWorkspace& workspace) {
  const int half = side / 2;
  const auto stride = static_cast<std::size_t>(width) * kOrientations;
  workspace.rows.resize(map.size());
  workspace.sums.resize(map.size());
  Number* rows = workspace.rows.data();
  for (int y = 0; y < height; ++y) {
    const Number* from = map.data() + static_cast<std::size_t>(y) * stride;
    Number* to = rows + static_cast<std::size_t>(y) * stride;
    Number sum[kOrientations] = {};
    for (int k = -half; k <= half; ++k) {
      const Number* pixel = from + std::clamp(k, 0, width - 1) * kOrientations;
      for (int o = 0; o < kOrientations; ++o) sum[o] = static_cast<Number>(sum[o] + pixel[o]);
    }
    for (int x = 0; x < width; ++x, to += kOrientations) {
      const Number* gone = from + std::max(0, x - half) * kOrientations;
      const Number* come = from + std::min(width - 1, x + half + 1) * kOrientations;
      for (int o = 0; o < kOrientations; ++o) {
        to[o] = sum[o];
        sum[o] = static_cast<Number>(sum[o] + come[o] - gone[o]);
      }
    }
  }
  workspace.columns.assign(stride, 0);
  Number* sums = workspace.columns.data();
  for (int k = -half; k <= half; ++k) {
    const Number* row = rows + static_cast<std::size_t>(std::clamp(k, 0, height - 1)) * stride;
    for (std::size_t i = 0; i < stride; ++i) sums[i] = static_cast<Number>(sums[i] + row[i]);
  }
  for (int y = 0; y < height; ++y) {
    const Number* gone = rows + static_cast<std::size_t>(std::max(0, y - half)) * stride;
    const Number* come =
        rows + static_cast<std::size_t>(std::min(height - 1, y + half + 1)) * stride;
    Number* to = workspace.sums.data() + static_cast<std::size_t>(y) * stride;
    for (std::size_t i = 0; i < stride; ++i) {
      to[i] = sums[i];
      sums[i] = static_cast<Number>(sums[i] + come[i] - gone[i]);
    }
  }
}

void normalize(float* descriptor) {
  float square = 1e-3F;
  for (int i = 0; i < kDescriptor; ++i) square += descriptor[i] * descriptor[i];
  const float scale = 1.F / std::sqrt(square);
  float again = 1e-6F;
  for (int i = 0; i < kDescriptor; ++i) {
    descriptor[i] = std::min(kClip, descriptor[i] * scale);
    again += descriptor[i] * descriptor[i];
  }
  const float second = 1.F / std::sqrt(again);
  for (int i = 0; i < kDescriptor; ++i) descriptor[i] *= second;
}

}  // namespace

void gradient_features(const cv::Mat& gray, const Eigen::Matrix<double, 2, 3>& upright,
                       const Eigen::Matrix2Xd& points, const FeatureScale& scale,
                       FeatureWorkspace& workspace, float* out) {
  require_gray(gray);
  // The points in the frame, and the frame's size: it contains all cells of all points.
  const Eigen::Matrix2Xd in_units =
      (upright.leftCols<2>() * points).colwise() + Eigen::Vector2d(upright.col(2));
  const double cell_px = scale.cell * scale.px_per_unit;
  const double reach = 0.5 * kCells * cell_px + kBorder;
  const Eigen::Vector2d low = in_units.rowwise().minCoeff() * scale.px_per_unit;
  const Eigen::Vector2d high = in_units.rowwise().maxCoeff() * scale.px_per_unit;
  TARSIER_REQUIRE(low.allFinite() && high.allFinite(), "points are not finite");
  constexpr double kMaxFrameSide = 1000;  // px; a degenerate shape is cut off
  const Eigen::Vector2d origin = (low.array() - reach).floor();
  const int width =
      static_cast<int>(std::min(kMaxFrameSide, std::ceil(high.x() + reach - origin.x()) + 1));
  const int height =
      static_cast<int>(std::min(kMaxFrameSide, std::ceil(high.y() + reach - origin.y()) + 1));

  // frame px = px_per_unit * upright x - origin
  Eigen::Matrix<double, 2, 3> frame_from_image = upright * scale.px_per_unit;
  frame_from_image.col(2) -= origin;
  cv::Mat forward(2, 3, CV_64F);
  for (int r = 0; r < 2; ++r) {
    for (int c = 0; c < 3; ++c) forward.at<double>(r, c) = frame_from_image(r, c);
  }
  cv::warpAffine(gray, workspace.frame, forward, cv::Size(width, height), cv::INTER_LINEAR,
                 cv::BORDER_REPLICATE);
  const int side =
      std::clamp(2 * static_cast<int>(std::lround(cell_px / 2 - 0.5)) + 1, 1, kMaxCellSide);
  // A projection is at most 361; the sum of `side` squared projections must fit into 16 bits.
  int shift = 0;
  while (((361 >> shift) + 1) * side * side > 65535) ++shift;
  project(workspace.frame, shift, workspace.gradients);
  pool(workspace.gradients, width, height, side, workspace);
  const auto unit = static_cast<float>(1 << shift) / static_cast<float>(side * side);

  const Number* map = workspace.sums.data();
  for (Eigen::Index p = 0; p < points.cols(); ++p) {
    float* descriptor = out + p * kDescriptor;
    float* to = descriptor;
    const double px = in_units(0, p) * scale.px_per_unit - origin.x();
    const double py = in_units(1, p) * scale.px_per_unit - origin.y();
    for (int v = 0; v < kCells; ++v) {
      const double y = std::clamp(py + (v - 0.5 * (kCells - 1)) * cell_px, 0.0, height - 1.001);
      for (int u = 0; u < kCells; ++u, to += kOrientations) {
        const double x = std::clamp(px + (u - 0.5 * (kCells - 1)) * cell_px, 0.0, width - 1.001);
        const int ix = static_cast<int>(x);
        const int iy = static_cast<int>(y);
        const auto fx = static_cast<float>(x - ix);
        const auto fy = static_cast<float>(y - iy);
        const Number* a = map + (static_cast<std::ptrdiff_t>(iy) * width + ix) * kOrientations;
        const Number* b = a + static_cast<std::ptrdiff_t>(width) * kOrientations;
        const float w00 = unit * (1 - fx) * (1 - fy);
        const float w01 = unit * fx * (1 - fy);
        const float w10 = unit * (1 - fx) * fy;
        const float w11 = unit * fx * fy;
        for (int o = 0; o < kOrientations; ++o) {
          to[o] = w00 * static_cast<float>(a[o]) + w01 * static_cast<float>(a[o + kOrientations]) +
                  w10 * static_cast<float>(b[o]) + w11 * static_cast<float>(b[o + kOrientations]);
        }
      }
    }
    normalize(descriptor);
  }
}

}  // namespace tarsier::face::regression
