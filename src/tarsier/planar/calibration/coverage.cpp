// SPDX-License-Identifier: MIT
#include "tarsier/planar/calibration/coverage.h"

#include "tarsier/core/require.h"
#include "tarsier/planar/calibration/lens_fit.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace tarsier::planar::calibration {
namespace {

constexpr double kTilted_deg = 12;
constexpr int kMinViews = 8;
constexpr std::array<const char*, 9> kRegionNames{
    "the top left", "the top",         "the top right", "the left",        "the middle",
    "the right",    "the bottom left", "the bottom",    "the bottom right"};
constexpr std::array<const char*, 4> kTilts{
    "the board, left edge closer", "the board, right edge closer", "the board, top edge closer",
    "the board, bottom edge closer"};

// Cells whose centre lies inside the points' convex hull, and cells that contain a point.
std::array<bool, kCoverageColumns * kCoverageRows> cells_of(const BoardView& view, cv::Size size) {
  std::array<bool, kCoverageColumns * kCoverageRows> cells{};
  std::vector<cv::Point2f> hull;
  cv::convexHull(view.pixels, hull);
  for (int row = 0; row < kCoverageRows; ++row) {
    for (int column = 0; column < kCoverageColumns; ++column) {
      const cv::Point2f center(
          static_cast<float>((column + 0.5) * size.width / kCoverageColumns - 0.5),
          static_cast<float>((row + 0.5) * size.height / kCoverageRows - 0.5));
      if (cv::pointPolygonTest(hull, center, false) >= 0)
        cells[static_cast<std::size_t>(row * kCoverageColumns + column)] = true;
    }
  }
  for (const cv::Point2f& p : view.pixels) {
    const int column =
        std::clamp(cvFloor((static_cast<double>(p.x) + 0.5) * kCoverageColumns / size.width), 0,
                   kCoverageColumns - 1);
    const int row =
        std::clamp(cvFloor((static_cast<double>(p.y) + 0.5) * kCoverageRows / size.height), 0,
                   kCoverageRows - 1);
    cells[static_cast<std::size_t>(row * kCoverageColumns + column)] = true;
  }
  return cells;
}

std::array<bool, 4> tilts_of(const BoardView& view, const BoardSpec& spec, cv::Size size) {
  const cv::Point2d tilt = tilt_of(view, spec, size);
  return {tilt.x<-kTilted_deg, tilt.x> kTilted_deg, tilt.y<-kTilted_deg, tilt.y> kTilted_deg};
}

}  // namespace

double view_distance(const BoardView& a, const BoardView& b) {
  double sum = 0;
  std::size_t common = 0;
  for (std::size_t i = 0, j = 0; i < a.points.size() && j < b.points.size();) {
    if (a.points[i] < b.points[j]) {
      ++i;
    } else if (a.points[i] > b.points[j]) {
      ++j;
    } else {
      sum += cv::norm(a.pixels[i++] - b.pixels[j++]);
      ++common;
    }
  }
  const std::size_t smaller = std::min(a.points.size(), b.points.size());
  return 2 * common > smaller ? sum / static_cast<double>(common)
                              : std::numeric_limits<double>::infinity();
}

cv::Point2d tilt_of(const BoardView& view, const BoardSpec& spec, cv::Size size) {
  geometry::Camera camera;
  camera.width = size.width;
  camera.height = size.height;
  camera.fx = camera.fy = 1.1 * std::max(size.width, size.height);
  camera.cx = (size.width - 1) / 2.0;
  camera.cy = (size.height - 1) / 2.0;
  FitView fit;
  for (std::size_t i = 0; i < view.points.size(); ++i) {
    fit.board.push_back(spec.point(view.points[i]));
    fit.pixels.emplace_back(view.pixels[i]);
  }
  const auto pose = start_pose(camera, fit);
  if (!pose) return {};
  // The plane n (X - X0) = 0 comes nearer by n_x / n_z for each step to the right.
  const double nz = pose->rotation(2, 2);
  return cv::Point2d(std::atan2(pose->rotation(0, 2), nz), std::atan2(pose->rotation(1, 2), nz)) *
         (180 / CV_PI);
}

double Coverage::share() const {
  const auto touched = std::count_if(cells.begin(), cells.end(), [](int n) { return n > 0; });
  return static_cast<double>(touched) / static_cast<double>(cells.size());
}

std::vector<std::string> Coverage::missing() const {
  std::vector<std::string> result;
  std::array<int, 9> touched{};
  std::array<int, 9> all{};
  for (int row = 0; row < kCoverageRows; ++row) {
    for (int column = 0; column < kCoverageColumns; ++column) {
      const auto place =
          static_cast<std::size_t>(row * 3 / kCoverageRows * 3 + column * 3 / kCoverageColumns);
      ++all[place];
      if (cells[static_cast<std::size_t>(row * kCoverageColumns + column)] > 0) ++touched[place];
    }
  }
  for (std::size_t k = 0; k < tilts.size(); ++k)
    if (tilts[k] == 0) result.emplace_back(kTilts[k]);
  for (std::size_t k = 0; k < 9; ++k)
    if (2 * touched[k] < all[k]) result.push_back(std::string(kRegionNames[k]) + " of the image");
  if (result.empty() && views < kMinViews)
    result.push_back(std::to_string(kMinViews - views) + " more views");
  return result;
}

double Coverage::gain(const BoardView& view, const BoardSpec& spec) const {
  TARSIER_REQUIRE(size.width > 0 && size.height > 0, "{}x{} px", size.width, size.height);
  if (view.empty()) return 0;
  const auto touches = cells_of(view, size);
  double fresh = 0;
  for (std::size_t k = 0; k < cells.size(); ++k)
    if (touches[k] && cells[k] == 0) fresh += 1;
  const auto turned = tilts_of(view, spec, size);
  double tilted = 0;
  for (std::size_t k = 0; k < tilts.size(); ++k)
    if (turned[k] && tilts[k] == 0) tilted += 1;
  return std::min(1.0, fresh / static_cast<double>(cells.size()) * 2 + 0.25 * tilted);
}

void Coverage::add(const BoardView& view, const BoardSpec& spec) {
  TARSIER_REQUIRE(size.width > 0 && size.height > 0, "{}x{} px", size.width, size.height);
  if (view.empty()) return;
  const auto touches = cells_of(view, size);
  for (std::size_t k = 0; k < cells.size(); ++k)
    if (touches[k]) ++cells[k];
  const auto turned = tilts_of(view, spec, size);
  for (std::size_t k = 0; k < tilts.size(); ++k)
    if (turned[k]) ++tilts[k];
  ++views;
}

Coverage coverage_of(const std::vector<BoardView>& views, const BoardSpec& spec, cv::Size size) {
  Coverage coverage;
  coverage.size = size;
  for (const BoardView& view : views) coverage.add(view, spec);
  return coverage;
}

}  // namespace tarsier::planar::calibration
