// SPDX-License-Identifier: MIT
#include "tarsier/planar/calibration/charuco.h"

#include "tarsier/planar/markers/detector.h"
#include "tarsier/planar/markers/dictionary.h"

#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <optional>

namespace tarsier::planar::calibration {
namespace {

// Share of the white margin between a corner and the nearest marker.
constexpr double kMarginWindow = 0.95;
constexpr double kMinSquare = 10;  // px
constexpr double kMaxDistance_squares =
    2.2;  // squares, from a marker's centre to a corner it predicts
constexpr double kMaxDisagreement_squares =
    0.2;  // squares, maximum difference of the predictions of one corner

// One marker: its square, and the homography from squares (of the board) to the image.
struct LocatedMarker {
  cv::Point2d center;  // in units of squares
  cv::Matx33d image_from_board;
};

cv::Point2d apply(const cv::Matx33d& map, const cv::Point2d& p) {
  const cv::Vec3d v = map * cv::Vec3d(p.x, p.y, 1);
  return {v[0] / v[2], v[1] / v[2]};
}

std::vector<LocatedMarker> find_markers(const cv::Mat& gray, const BoardSpec& spec) {
  const std::vector<cv::Point> squares = marker_squares(spec);
  markers::DetectWorkspace workspace;
  std::vector<LocatedMarker> located;
  for (const markers::Marker& found :
       markers::detect_markers(gray, markers::find_dictionary(spec.family), {}, workspace)) {
    if (static_cast<std::size_t>(found.id) >= squares.size()) continue;
    const cv::Point2d center =
        cv::Point2d(squares[static_cast<std::size_t>(found.id)]) + cv::Point2d(0.5, 0.5);
    const double half = spec.ratio / 2;
    const std::vector<cv::Point2d> board{
        center + cv::Point2d(-half, -half), center + cv::Point2d(half, -half),
        center + cv::Point2d(half, half), center + cv::Point2d(-half, half)};
    std::vector<cv::Point2d> pixels;
    for (const Eigen::Vector2d& corner : found.corners) pixels.emplace_back(corner.x(), corner.y());
    const cv::Mat map = cv::findHomography(board, pixels, 0);
    if (map.empty()) continue;
    located.push_back({center, cv::Matx33d(map)});
  }
  return located;
}

struct Prediction {
  cv::Point2d pixel;
  double square_px = 0;  // shortest side of a square near the corner
};

// Predicts a corner (in units of squares) from the markers around it, with higher weights for
// nearer ones. Returns nothing if there is no marker, or if the predictions contradict each other.
std::optional<Prediction> predict(const std::vector<LocatedMarker>& located,
                                  const cv::Point2d& corner) {
  cv::Point2d sum;
  double weight = 0;
  double square_px = 0;
  std::vector<cv::Point2d> all;
  for (const LocatedMarker& marker : located) {
    const double distance = cv::norm(marker.center - corner);
    if (distance > kMaxDistance_squares) continue;
    const cv::Point2d pixel = apply(marker.image_from_board, corner);
    const double px =
        std::min(cv::norm(apply(marker.image_from_board, corner + cv::Point2d(0.5, 0)) -
                          apply(marker.image_from_board, corner - cv::Point2d(0.5, 0))),
                 cv::norm(apply(marker.image_from_board, corner + cv::Point2d(0, 0.5)) -
                          apply(marker.image_from_board, corner - cv::Point2d(0, 0.5))));
    if (!std::isfinite(pixel.x) || !std::isfinite(pixel.y) || !std::isfinite(px)) continue;
    const double w = 1 / std::pow(distance, 4);
    sum += w * pixel;
    square_px += w * px;
    weight += w;
    if (distance < 1) all.push_back(pixel);  // of the two squares that touch the corner
  }
  if (!(weight > 0) || all.empty()) return std::nullopt;
  const Prediction result{sum * (1 / weight), square_px / weight};
  for (const cv::Point2d& pixel : all)
    if (cv::norm(pixel - result.pixel) > kMaxDisagreement_squares * result.square_px)
      return std::nullopt;
  return result;
}

}  // namespace

BoardView find_charuco(const cv::Mat& gray, const BoardSpec& spec, int min_corners) {
  const std::vector<LocatedMarker> located = find_markers(gray, spec);
  BoardView view;
  for (int index = 0; index < spec.points(); ++index) {
    const int width = spec.grid().width;
    const auto at = predict(located, cv::Point2d(index % width + 1, index / width + 1));
    if (!at) continue;
    const double rim = 0.5 * (1 - spec.ratio) * at->square_px;
    const int half = std::clamp(cvFloor(kMarginWindow * rim), 2, kMaxHalfWindow_px);
    const cv::Rect2d inside(half + 2, half + 2, gray.cols - 2 * half - 4, gray.rows - 2 * half - 4);
    if (at->square_px < kMinSquare || !inside.contains(at->pixel)) continue;
    std::vector<cv::Point2f> pixel{at->pixel};
    cv::cornerSubPix(gray, pixel, {half, half}, {-1, -1},
                     {cv::TermCriteria::EPS | cv::TermCriteria::COUNT, 60, 1e-3});
    if (cv::norm(cv::Point2d(pixel[0]) - at->pixel) > 0.25 * at->square_px) continue;
    view.points.push_back(index);
    view.pixels.push_back(pixel[0]);
  }
  if (static_cast<int>(view.points.size()) < min_corners) return {};
  // Corners on one line of the board do not determine a pose.
  const int width = spec.grid().width;
  const auto all_equal = [&](const auto& of) {
    return std::all_of(view.points.begin(), view.points.end(),
                       [&](int p) { return of(p) == of(view.points[0]); });
  };
  if (all_equal([&](int p) { return p / width; }) || all_equal([&](int p) { return p % width; }))
    return {};
  return view;
}

}  // namespace tarsier::planar::calibration
