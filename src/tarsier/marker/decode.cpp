// SPDX-License-Identifier: MIT
#include "tarsier/marker/decode.h"

#include "tarsier/core/require.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>

namespace tarsier::marker {
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
  // A little stiffness: few samples make no steep plane.
  void solve() {
    Eigen::Matrix3d damped = normal;
    damped(0, 0) += 0.05 * normal(2, 2);
    damped(1, 1) += 0.05 * normal(2, 2);
    value = damped.ldlt().solve(right);
  }
  [[nodiscard]] double at(double x, double y) const { return value.dot(Eigen::Vector3d(x, y, 1)); }
};

// Brightness at a place in cells; nothing outside the picture.
class Cells {
 public:
  Cells(const cv::Mat& gray, const Quad& quad, int cells)
      : gray_(gray), map_(picture_from_cells(quad, cells)), middle_((cells + 2) / 2.0) {}

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

void DecodeOptions::check() const {
  TARSIER_REQUIRE(max_errors >= -1 && max_errors <= 32, "{} errors", max_errors);
  TARSIER_REQUIRE(min_contrast >= 1 && min_contrast <= 255, "a contrast of {}", min_contrast);
  TARSIER_REQUIRE(border_errors >= 0 && border_errors < 0.5, "{} of the frame", border_errors);
}

Eigen::Matrix3d picture_from_cells(const Quad& quad, int cells) {
  // The unit square's homography in closed form (Heckbert 1989), then scaled to cells.
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

std::optional<Reading> read_quad(const cv::Mat& gray, const Quad& quad,
                                 const Dictionary& dictionary, const DecodeOptions& options) {
  const int n = dictionary.cells();
  const Cells cells(gray, quad, n);
  Plane black;
  Plane white;
  const double m = cells.middle();
  // The frame's middle line, and the paper three tenths of a cell outside.
  const double outside = -0.35;
  int bright = 0;
  int frame = 0;
  std::vector<std::array<double, 3>> ring;
  for (int i = 0; i < n + 2; ++i) {
    const double t = i + 0.5;
    const double far = n + 2;
    for (const auto& [u, v] :
         {std::pair{t, 0.5}, std::pair{t, far - 0.5}, std::pair{0.5, t}, std::pair{far - 0.5, t}}) {
      if (const auto value = cells.at(u, v)) {
        black.add(u - m, v - m, *value);
        ring.push_back({u, v, *value});
      }
    }
    for (const auto& [u, v] : {std::pair{t, outside}, std::pair{t, far - outside},
                               std::pair{outside, t}, std::pair{far - outside, t}}) {
      if (const auto value = cells.at(u, v)) white.add(u - m, v - m, *value);
    }
  }
  if (black.normal(2, 2) < 2 * (n + 2) || white.normal(2, 2) < 2 * (n + 2)) return std::nullopt;
  black.solve();
  white.solve();
  const double contrast = white.at(0, 0) - black.at(0, 0);
  if (contrast < options.min_contrast) return std::nullopt;
  const auto threshold = [&](double u, double v) {
    return 0.5 * (black.at(u - m, v - m) + white.at(u - m, v - m));
  };
  for (const auto& [u, v, value] : ring) {
    ++frame;
    bright += value > threshold(u, v) ? 1 : 0;
  }
  if (bright > options.border_errors * frame) return std::nullopt;

  // A first reading, then white as the bright cells have it: the paper around may be in another
  // light than the marker.
  std::vector<double> values(static_cast<std::size_t>(n) * static_cast<std::size_t>(n), 0);
  Code unknown = 0;
  for (int row = 0; row < n; ++row) {
    for (int column = 0; column < n; ++column) {
      const auto value = cells.cell(column + 1, row + 1);
      const auto index = static_cast<std::size_t>(row * n + column);
      if (value)
        values[index] = *value;
      else
        unknown |= Code{1} << (n * n - 1 - static_cast<int>(index));
    }
  }
  for (int row = 0; row < n; ++row) {
    for (int column = 0; column < n; ++column) {
      const double value = values[static_cast<std::size_t>(row * n + column)];
      const double u = column + 1.5;
      const double v = row + 1.5;
      (value > threshold(u, v) ? white : black).add(u - m, v - m, value);
    }
  }
  black.solve();
  white.solve();
  Code code = 0;
  double clear = 0;
  for (int row = 0; row < n; ++row) {
    for (int column = 0; column < n; ++column) {
      const double u = column + 1.5;
      const double v = row + 1.5;
      const double value = values[static_cast<std::size_t>(row * n + column)];
      const double half = std::max(1.0, 0.5 * (white.at(u - m, v - m) - black.at(u - m, v - m)));
      code = (code << 1) | (value > threshold(u, v) ? 1U : 0U);
      clear += std::min(1.0, std::abs(value - threshold(u, v)) / half);
    }
  }
  const int mend =
      options.max_errors >= 0 ? options.max_errors : (dictionary.correctable() + 1) / 2;
  const auto match = dictionary.match(code, std::min(mend, dictionary.correctable()), unknown);
  if (!match) return std::nullopt;
  Reading reading;
  reading.match = *match;
  reading.contrast = contrast;
  reading.margin = clear / (n * n);
  return reading;
}

}  // namespace tarsier::marker
