// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/decode.h"

#include "tarsier/core/require.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>

namespace tarsier::planar::markers {
namespace {

// Least squares of value = a x + b y + c.
struct Plane {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  Eigen::Vector3d value = Eigen::Vector3d::Zero();

  void add(double x, double y, double v) {
    const Eigen::Vector3d row(x, y, 1);
    normal += row * row.transpose();
    right += v * row;
  }
  // Slightly regularised: few samples do not give a steep plane.
  void solve() {
    Eigen::Matrix3d damped = normal;
    damped(0, 0) += 0.05 * normal(2, 2);
    damped(1, 1) += 0.05 * normal(2, 2);
    value = damped.ldlt().solve(right);
  }
  [[nodiscard]] double at(double x, double y) const { return value.dot(Eigen::Vector3d(x, y, 1)); }
};

// Brightness at a position in cells; nothing outside the image.
class Sampler {
 public:
  Sampler(const cv::Mat& gray, const Quad& quad, int cells)
      : gray_(gray), map_(image_from_cells(quad, cells)), middle_((cells + 2) / 2.0) {}

  [[nodiscard]] std::optional<double> at(double u, double v) const {
    const Eigen::Vector3d p = map_ * Eigen::Vector3d(u, v, 1);
    const double x = p.x() / p.z();
    const double y = p.y() / p.z();
    if (!(p.z() > 0 && x >= 0 && y >= 0 && x < gray_.cols - 1.001 && y < gray_.rows - 1.001))
      return std::nullopt;
    const int x0 = static_cast<int>(x);
    const int y0 = static_cast<int>(y);
    const double fx = x - x0;
    const double fy = y - y0;
    const auto* a = gray_.ptr<std::uint8_t>(y0) + x0;
    const auto* b = gray_.ptr<std::uint8_t>(y0 + 1) + x0;
    return (1 - fy) * ((1 - fx) * a[0] + fx * a[1]) + fy * ((1 - fx) * b[0] + fx * b[1]);
  }
  // Mean of a few samples in the inner part of a cell.
  [[nodiscard]] std::optional<double> cell(int column, int row) const {
    double sum = 0;
    int count = 0;
    for (const double du : {0.3, 0.5, 0.7}) {
      for (const double dv : {0.3, 0.5, 0.7}) {
        if (const auto value = at(column + du, row + dv)) {
          sum += *value;
          ++count;
        }
      }
    }
    if (count < 5) return std::nullopt;
    return sum / count;
  }
  [[nodiscard]] double middle() const { return middle_; }

 private:
  const cv::Mat& gray_;
  Eigen::Matrix3d map_;
  double middle_;
};

}  // namespace

Eigen::Matrix3d image_from_cells(const Quad& quad, int cells) {
  // Closed-form homography of the unit square (Heckbert 1989), then scaled to cells.
  const Eigen::Vector2d d1 = quad[1] - quad[2];
  const Eigen::Vector2d d2 = quad[3] - quad[2];
  const Eigen::Vector2d s = quad[0] - quad[1] + quad[2] - quad[3];
  const double cross = d1.x() * d2.y() - d1.y() * d2.x();
  TARSIER_REQUIRE(std::abs(cross) > 1e-9, "corners on a line");
  const double g = (s.x() * d2.y() - s.y() * d2.x()) / cross;
  const double h = (d1.x() * s.y() - d1.y() * s.x()) / cross;
  Eigen::Matrix3d map;
  map.col(0) << quad[1] - quad[0] + g * quad[1], g;
  map.col(1) << quad[3] - quad[0] + h * quad[3], h;
  map.col(2) << quad[0], 1;
  map.leftCols(2) /= cells + 2;
  return map;
}

std::optional<Cells> read_cells(const cv::Mat& gray, const Quad& quad, int n, double min_contrast) {
  TARSIER_REQUIRE(gray.type() == CV_8UC1, "an image that is not grey");
  TARSIER_REQUIRE(n >= 3 && n <= 8, "{} cells", n);
  const Sampler sampler(gray, quad, n);
  Plane black;
  Plane white;
  const double m = sampler.middle();
  // The centre line of the frame, and the paper a third of a cell outside.
  const double outside = -0.35;
  const double far = n + 2;
  std::vector<std::array<double, 3>> frame;
  for (int i = 0; i < n + 2; ++i) {
    const double t = i + 0.5;
    for (const auto& [u, v] :
         {std::pair{t, 0.5}, std::pair{t, far - 0.5}, std::pair{0.5, t}, std::pair{far - 0.5, t}}) {
      if (const auto value = sampler.at(u, v)) {
        black.add(u - m, v - m, *value);
        frame.push_back({u, v, *value});
      }
    }
    for (const auto& [u, v] : {std::pair{t, outside}, std::pair{t, far - outside},
                               std::pair{outside, t}, std::pair{far - outside, t}}) {
      if (const auto value = sampler.at(u, v)) white.add(u - m, v - m, *value);
    }
  }
  if (black.normal(2, 2) < 2 * (n + 2) || white.normal(2, 2) < 2 * (n + 2)) return std::nullopt;
  black.solve();
  white.solve();
  Cells cells;
  cells.count = n;
  cells.contrast = white.at(0, 0) - black.at(0, 0);
  if (!(cells.contrast >= min_contrast)) return std::nullopt;
  const auto light_of = [&](double u, double v, double value) {
    const double low = black.at(u - m, v - m);
    const double half = std::max(1.0, 0.5 * (white.at(u - m, v - m) - low));
    return (value - low) / half - 1;
  };
  for (const auto& [u, v, value] : frame) cells.frame_errors += light_of(u, v, value) > 0 ? 1 : 0;
  cells.frame_errors /= static_cast<double>(frame.size());

  // First estimate; then white is fitted to the bright cells, because the light on the surrounding
  // paper may differ from that on the marker.
  const auto total = static_cast<std::size_t>(n) * static_cast<std::size_t>(n);
  std::array<double, 64> values{};
  for (std::size_t i = 0; i < total; ++i) {
    const int column = static_cast<int>(i) % n;
    const int row = static_cast<int>(i) / n;
    if (const auto value = sampler.cell(column + 1, row + 1))
      values[i] = *value;
    else
      cells.unknown |= Code{1} << (total - 1 - i);
  }
  const auto is_known = [&](std::size_t i) {
    return ((cells.unknown >> (total - 1 - i)) & 1U) == 0;
  };
  const auto place = [&](std::size_t i) {
    return std::pair{static_cast<int>(i) % n + 1.5, static_cast<int>(i) / n + 1.5};
  };
  std::array<bool, 64> is_white{};
  for (std::size_t i = 0; i < total; ++i) {
    const auto [u, v] = place(i);
    is_white[i] = light_of(u, v, values[i]) > 0;
  }
  for (std::size_t i = 0; i < total; ++i) {
    const auto [u, v] = place(i);
    if (is_known(i)) (is_white[i] ? white : black).add(u - m, v - m, values[i]);
  }
  black.solve();
  white.solve();
  for (std::size_t i = 0; i < total; ++i) {
    const auto [u, v] = place(i);
    const double light = is_known(i) ? light_of(u, v, values[i]) : 0;
    cells.light[i] = static_cast<float>(light);
    cells.read = (cells.read << 1U) | (light > 0 ? 1U : 0U);
    cells.margin += std::min(1.0, std::abs(light)) / static_cast<double>(total);
  }
  return cells;
}

Cells sharpened(const Cells& cells, float strength) {
  const int n = cells.count;
  Cells result = cells;
  result.read = 0;
  result.margin = 0;
  const auto at = [&](int column, int row) {
    if (column < 0 || row < 0 || column >= n || row >= n) return -1.0F;  // the frame is black
    return cells.light[static_cast<std::size_t>(row * n + column)];
  };
  for (int row = 0; row < n; ++row) {
    for (int column = 0; column < n; ++column) {
      const float around =
          (at(column - 1, row) + at(column + 1, row) + at(column, row - 1) + at(column, row + 1)) /
          4;
      const float here = at(column, row);
      const float light = here + strength * (here - around);
      result.light[static_cast<std::size_t>(row * n + column)] = light;
      result.read = (result.read << 1U) | (light > 0 ? 1U : 0U);
      result.margin += std::min(1.0F, std::abs(light)) / static_cast<float>(n * n);
    }
  }
  return result;
}

}  // namespace tarsier::planar::markers
