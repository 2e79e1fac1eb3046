// SPDX-License-Identifier: MIT
#include "tarsier/planar/calibration/detect.h"

#include "tarsier/core/require.h"
#include "tarsier/media/gray_image.h"
#include "tarsier/planar/calibration/charuco.h"

#include <fmt/format.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

namespace tarsier::planar::calibration {
namespace {

constexpr int kMinImageSide = 16;  // px
constexpr double kSquareWindow =
    0.4;  // of a square, so that it excludes neighbouring saddle points

// The image, reduced so that its larger side is at most `side` px, and the scale full / reduced.
struct Reduced {
  cv::Mat gray;
  double scale = 1;

  Reduced(const cv::Mat& full, int side) : gray(full) {
    const int larger = std::max(full.cols, full.rows);
    if (larger <= side) return;
    const double factor = static_cast<double>(larger) / side;
    cv::resize(full, gray,
               {std::max(kMinImageSide, cvRound(full.cols / factor)),
                std::max(kMinImageSide, cvRound(full.rows / factor))},
               0, 0, cv::INTER_AREA);
    scale = static_cast<double>(full.cols) / gray.cols;
  }
  [[nodiscard]] cv::Point2f full_of(const cv::Point2f& p) const {
    return {static_cast<float>((p.x + 0.5) * scale - 0.5),
            static_cast<float>((p.y + 0.5) * scale - 0.5)};
  }
};

// Evens the light: subtracts the local mean and divides by the local deviation.
cv::Mat evenly_lit(const cv::Mat& gray) {
  constexpr double kFlat = 6;     // grey levels; a smaller deviation is a flat region
  constexpr double kSpread = 50;  // grey levels per deviation
  const int side = std::max(15, std::max(gray.cols, gray.rows) / 7 | 1);
  cv::Mat value;
  gray.convertTo(value, CV_32F);
  cv::Mat mean;
  cv::Mat square;
  cv::boxFilter(value, mean, CV_32F, {side, side}, {-1, -1}, true, cv::BORDER_REFLECT_101);
  cv::sqrBoxFilter(value, square, CV_32F, {side, side}, {-1, -1}, true, cv::BORDER_REFLECT_101);
  cv::Mat deviation;
  cv::sqrt(cv::max(square - mean.mul(mean), kFlat * kFlat), deviation);
  cv::Mat even;
  cv::Mat(128 + kSpread * (value - mean) / deviation).convertTo(even, CV_8U);
  return even;
}

// The minimum distance of each point to its neighbours in the grid.
double min_spacing(const std::vector<cv::Point2f>& pixels, const cv::Size& grid) {
  double min_distance = std::numeric_limits<double>::infinity();
  for (int row = 0; row < grid.height; ++row) {
    for (int column = 0; column < grid.width; ++column) {
      const auto i = static_cast<std::size_t>(row * grid.width + column);
      if (column > 0) min_distance = std::min(min_distance, cv::norm(pixels[i] - pixels[i - 1]));
      if (row > 0) {
        min_distance = std::min(
            min_distance, cv::norm(pixels[i] - pixels[i - static_cast<std::size_t>(grid.width)]));
      }
    }
  }
  return min_distance;
}

BoardView whole_view(std::vector<cv::Point2f> pixels) {
  BoardView view;
  view.pixels = std::move(pixels);
  view.points.resize(view.pixels.size());
  std::iota(view.points.begin(), view.points.end(), 0);
  return view;
}

// --- chess ---

// Whether four squares meet at `at`: opposite quadrants alike, neighbouring ones different. `u` and
// `v` point to the next corners of the grid.
bool is_crossing(const cv::Mat& gray, const cv::Point2f& at, const cv::Point2f& u,
                 const cv::Point2f& v) {
  std::array<double, 4> quarter{};
  for (std::size_t k = 0; k < 4; ++k) {
    const float su = k == 0 || k == 3 ? 0.4F : -0.4F;
    const float sv = k < 2 ? 0.4F : -0.4F;
    const cv::Point2f p = at + su * u + sv * v;
    const cv::Point q(cvRound(p.x), cvRound(p.y));
    if (!cv::Rect(0, 0, gray.cols, gray.rows).contains(q)) return false;
    quarter[k] = gray.at<uchar>(q);
  }
  const double contrast = std::abs(quarter[0] + quarter[2] - quarter[1] - quarter[3]) / 2;
  return contrast > 25 && std::abs(quarter[0] - quarter[2]) < 0.4 * contrast &&
         std::abs(quarter[1] - quarter[3]) < 0.4 * contrast;
}

// Whether there are further corners beyond a side of the grid, so that the image shows a larger
// board.
bool is_larger_board(const cv::Mat& gray, const cv::Size& grid,
                     const std::vector<cv::Point2f>& pixels) {
  const auto at = [&](int column, int row) {
    return pixels[static_cast<std::size_t>(row * grid.width + column)];
  };
  const int right = grid.width - 1;
  const int bottom = grid.height - 1;
  // Extrapolates one step beyond the last corner, from the last two steps.
  const auto beyond = [](const cv::Point2f& last, const cv::Point2f& before,
                         const cv::Point2f& third) {
    return (last - before) * 2 - (before - third);
  };
  std::array<int, 4> crossings{};
  for (int row = 0; row <= bottom; ++row) {
    const int other = row < bottom ? row + 1 : row - 1;
    const auto look = [&](int last, int before, int third) {
      const cv::Point2f step = beyond(at(last, row), at(before, row), at(third, row));
      return is_crossing(gray, at(last, row) + step, step, at(last, other) - at(last, row));
    };
    crossings[0] += look(0, 1, 2) ? 1 : 0;
    crossings[1] += look(right, right - 1, right - 2) ? 1 : 0;
  }
  for (int column = 0; column <= right; ++column) {
    const int other = column < right ? column + 1 : column - 1;
    const auto look = [&](int last, int before, int third) {
      const cv::Point2f step = beyond(at(column, last), at(column, before), at(column, third));
      return is_crossing(gray, at(column, last) + step, step, at(other, last) - at(column, last));
    };
    crossings[2] += look(0, 1, 2) ? 1 : 0;
    crossings[3] += look(bottom, bottom - 1, bottom - 2) ? 1 : 0;
  }
  return 4 * std::max(crossings[0], crossings[1]) > 3 * grid.height ||
         4 * std::max(crossings[2], crossings[3]) > 3 * grid.width;
}

// Whether the points are corners of four squares, without further corners between neighbours. A
// grid that skips every other column and ends at the board's margin is not a view of the board.
bool is_grid_of_corners(const cv::Mat& gray, const cv::Size& grid,
                        const std::vector<cv::Point2f>& pixels) {
  const auto at = [&](int column, int row) {
    return pixels[static_cast<std::size_t>(row * grid.width + column)];
  };
  int crossings = 0;
  int between = 0;
  for (int row = 0; row < grid.height; ++row) {
    for (int column = 0; column < grid.width; ++column) {
      const cv::Point2f u = column + 1 < grid.width ? at(column + 1, row) - at(column, row)
                                                    : at(column, row) - at(column - 1, row);
      const cv::Point2f v = row + 1 < grid.height ? at(column, row + 1) - at(column, row)
                                                  : at(column, row) - at(column, row - 1);
      if (is_crossing(gray, at(column, row), u, v)) ++crossings;
      if (is_crossing(gray, at(column, row) + 0.5F * u, 0.5F * u, v) ||
          is_crossing(gray, at(column, row) + 0.5F * v, u, 0.5F * v)) {
        ++between;
      }
    }
  }
  return 10 * crossings >= 8 * grid.area() && 10 * between <= 2 * grid.area();
}

bool search_chess(const cv::Mat& gray, const cv::Size& grid, bool retry,
                  std::vector<cv::Point2f>& pixels) {
  const auto is_board = [&] {
    const cv::Mat even = evenly_lit(gray);
    return is_grid_of_corners(even, grid, pixels) && !is_larger_board(even, grid, pixels);
  };
  if (cv::findChessboardCornersSB(gray, grid, pixels, cv::CALIB_CB_NORMALIZE_IMAGE))
    return is_board();
  if (!retry) return false;
  if (cv::findChessboardCornersSB(evenly_lit(gray), grid, pixels, 0) && is_board()) return true;
  // Without adaptive thresholds, which take seconds for a board of another size.
  return cv::findChessboardCorners(gray, grid, pixels, cv::CALIB_CB_FAST_CHECK) && is_board();
}

// Fails if corners moved far: they have converged to another corner or to the background.
bool refine(const cv::Mat& gray, std::vector<cv::Point2f>& pixels, double spacing) {
  const int half = std::clamp(cvFloor(kSquareWindow * spacing), 1, kMaxHalfWindow_px);
  const std::vector<cv::Point2f> before = pixels;
  cv::cornerSubPix(gray, pixels, {half, half}, {-1, -1},
                   {cv::TermCriteria::EPS | cv::TermCriteria::COUNT, 60, 1e-3});
  for (std::size_t i = 0; i < pixels.size(); ++i)
    if (cv::norm(pixels[i] - before[i]) > 0.5 * spacing) return false;
  return true;
}

BoardView find_chess(const cv::Mat& full, const BoardSpec& spec, const FindOptions& options) {
  const Reduced reduced(full, options.search_px);
  std::vector<cv::Point2f> pixels;
  const cv::Mat searched = options.even_light ? evenly_lit(reduced.gray) : reduced.gray;
  if (!search_chess(searched, spec.grid(), options.retry, pixels)) return {};
  for (cv::Point2f& p : pixels) p = reduced.full_of(p);
  const double spacing = min_spacing(pixels, spec.grid());
  if (!(spacing >= 4)) return {};
  // From the reduced to the full image in steps, each starting from the last result.
  if (reduced.scale > 2) {
    const Reduced intermediate(full, cvRound(options.search_px * std::sqrt(reduced.scale)));
    for (cv::Point2f& p : pixels) {
      p = cv::Point2f(static_cast<float>((p.x + 0.5) / intermediate.scale - 0.5),
                      static_cast<float>((p.y + 0.5) / intermediate.scale - 0.5));
    }
    if (!refine(intermediate.gray, pixels, spacing / intermediate.scale)) return {};
    for (cv::Point2f& p : pixels) p = intermediate.full_of(p);
  }
  if (!refine(full, pixels, spacing)) return {};
  return whole_view(std::move(pixels));
}

// --- dots ---

// Blobs in the image, most dot-like first; at most `max_blobs`, because the time of the search for
// the grid grows with the square of their number.
std::vector<cv::Point2f> find_blobs(const cv::Mat& gray, std::size_t max_blobs) {
  cv::SimpleBlobDetector::Params params;
  params.minThreshold = 20;
  params.maxThreshold = 220;
  params.thresholdStep = 15;
  params.minDistBetweenBlobs = 3;
  params.filterByArea = true;
  params.minArea = 12;
  params.maxArea = 0.02F * static_cast<float>(gray.total());
  params.filterByCircularity = false;
  params.filterByInertia = true;
  params.minInertiaRatio = 0.08F;
  params.filterByConvexity = true;
  params.minConvexity = 0.9F;
  std::vector<cv::KeyPoint> blobs;
  cv::SimpleBlobDetector::create(params)->detect(gray, blobs);
  if (blobs.size() > max_blobs) {
    // The dots of a board are alike: those nearest to the median size are kept.
    std::vector<float> sizes;
    sizes.reserve(blobs.size());
    for (const cv::KeyPoint& blob : blobs) sizes.push_back(blob.size);
    std::nth_element(sizes.begin(), sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2),
                     sizes.end());
    const double median = sizes[sizes.size() / 2];
    std::stable_sort(blobs.begin(), blobs.end(), [&](const auto& a, const auto& b) {
      return std::abs(std::log(a.size / median)) < std::abs(std::log(b.size / median));
    });
    blobs.resize(max_blobs);
  }
  std::vector<cv::Point2f> points;
  points.reserve(blobs.size());
  for (const cv::KeyPoint& blob : blobs) points.push_back(blob.pt);
  return points;
}

// The dot's darkness-weighted centroid in the full image, within a disk that extends half way to
// its neighbours.
cv::Point2f dot_center(const cv::Mat& gray, const cv::Point2f& start, double reach) {
  cv::Point2d center = start;
  for (int turn = 0; turn < 3; ++turn) {
    const int x0 = std::max(0, cvFloor(center.x - reach));
    const int x1 = std::min(gray.cols - 1, cvCeil(center.x + reach));
    const int y0 = std::max(0, cvFloor(center.y - reach));
    const int y1 = std::min(gray.rows - 1, cvCeil(center.y + reach));
    double paper = 0;
    int count = 0;
    const auto inside = [&](int x, int y) {
      return std::hypot(x - center.x, y - center.y) <= reach;
    };
    // Paper brightness: the mean of the disk's outermost ring.
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        if (inside(x, y) && std::hypot(x - center.x, y - center.y) > reach - 1.5) {
          paper += gray.at<uchar>(y, x);
          ++count;
        }
      }
    }
    if (count == 0) return start;
    paper /= count;
    double weight = 0;
    cv::Point2d sum;
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        const double dark = inside(x, y) ? std::max(0.0, paper - 8 - gray.at<uchar>(y, x)) : 0;
        weight += dark;
        sum += dark * cv::Point2d(x, y);
      }
    }
    if (!(weight > 0)) return start;
    const cv::Point2d next = sum * (1 / weight);
    if (cv::norm(next - cv::Point2d(start)) > reach) return start;
    center = next;
  }
  return center;
}

BoardView find_dots(const cv::Mat& full, const BoardSpec& spec, const FindOptions& options) {
  // Dots are smaller than squares, so the first search uses a larger image.
  const Reduced reduced(full, options.search_px * 3 / 2);
  const auto needed = static_cast<std::size_t>(spec.points());
  std::vector<cv::Point2f> pixels;
  const std::vector<cv::Point2f> blobs =
      find_blobs(options.even_light ? evenly_lit(reduced.gray) : reduced.gray, 2 * needed + 40);
  if (blobs.size() < needed && options.retry && !options.even_light) {
    FindOptions even = options;
    even.even_light = true;
    return find_dots(full, spec, even);
  }
  if (blobs.size() < needed) return {};
  const int flags =
      spec.kind == BoardKind::kCircles ? cv::CALIB_CB_ASYMMETRIC_GRID : cv::CALIB_CB_SYMMETRIC_GRID;
  bool found = cv::findCirclesGrid(blobs, spec.grid(), pixels, flags, nullptr);
  if (!found && options.retry) {
    found =
        cv::findCirclesGrid(blobs, spec.grid(), pixels, flags | cv::CALIB_CB_CLUSTERING, nullptr);
  }
  if (!found || pixels.size() != needed) return {};
  double spacing = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < pixels.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      spacing = std::min(spacing, cv::norm(pixels[i] - pixels[j]) * reduced.scale);
  for (cv::Point2f& p : pixels) p = dot_center(full, reduced.full_of(p), 0.55 * spacing);
  return whole_view(std::move(pixels));
}

}  // namespace

BoardView find_board(const cv::Mat& image, const BoardSpec& spec, const FindOptions& options) {
  spec.check();
  options.check();
  const cv::Mat gray = gray_of(image);
  if (std::min(gray.cols, gray.rows) < kMinImageSide) return {};
  switch (spec.kind) {
    case BoardKind::kChess:
      return find_chess(gray, spec, options);
    case BoardKind::kCharuco:
      return find_charuco(gray, spec, options.min_corners);
    case BoardKind::kCircles:
    case BoardKind::kCirclesGrid:
      break;
  }
  return find_dots(gray, spec, options);
}

double sharpness_of(const cv::Mat& image, const BoardView& view, const BoardSpec& spec) {
  const bool is_chess = spec.kind == BoardKind::kChess || spec.kind == BoardKind::kCharuco;
  if (!is_chess || view.empty()) return 0;
  const cv::Mat gray = gray_of(image);
  const int width = spec.grid().width;
  double sum = 0;
  int count = 0;
  // Half way between two corners lies a straight edge between black and white: measures the step
  // across it.
  for (std::size_t i = 1; i < view.points.size(); ++i) {
    if (view.points[i] != view.points[i - 1] + 1 || view.points[i] % width == 0) continue;
    const cv::Point2d a = view.pixels[i - 1];
    const cv::Point2d b = view.pixels[i];
    const double length = cv::norm(b - a);
    if (length < 6) continue;
    const cv::Point2d across((a.y - b.y) / length, (b.x - a.x) / length);
    const double reach = 0.35 * length;
    const auto at = [&](double t) -> std::optional<double> {
      const cv::Point2d p = 0.5 * (a + b) + t * across;
      const int x = cvFloor(p.x);
      const int y = cvFloor(p.y);
      if (x < 0 || y < 0 || x + 1 >= gray.cols || y + 1 >= gray.rows) return std::nullopt;
      const double fx = p.x - x;
      const double fy = p.y - y;
      return (1 - fy) * ((1 - fx) * gray.at<uchar>(y, x) + fx * gray.at<uchar>(y, x + 1)) +
             fy * ((1 - fx) * gray.at<uchar>(y + 1, x) + fx * gray.at<uchar>(y + 1, x + 1));
    };
    double steepest = 0;
    const auto first = at(-reach);
    const auto last = at(reach);
    if (!first || !last || std::abs(*last - *first) < 20) continue;
    for (double t = -reach; t + 1 <= reach; t += 0.5) {
      const auto low = at(t);
      const auto high = at(t + 1);
      if (low && high) steepest = std::max(steepest, std::abs(*high - *low));
    }
    sum += steepest / std::abs(*last - *first);
    ++count;
  }
  return count > 0 ? std::min(1.0, sum / count) : 0;
}

std::vector<std::string> other_chess_sizes(const cv::Mat& image, const BoardSpec& spec) {
  std::vector<std::string> sizes;
  if (spec.kind != BoardKind::kChess) return sizes;
  const Reduced reduced(gray_of(image), 640);
  if (std::min(reduced.gray.cols, reduced.gray.rows) < kMinImageSide) return sizes;
  constexpr std::array<std::array<int, 2>, 8> kSteps{
      {{-1, -1}, {-1, 0}, {0, -1}, {1, 0}, {0, 1}, {1, 1}, {-2, 0}, {0, -2}}};
  std::vector<cv::Point2f> pixels;
  for (const auto& step : kSteps) {
    const cv::Size grid(spec.columns + step[0], spec.rows + step[1]);
    if (grid.width < 3 || grid.height < 3) continue;
    if (search_chess(reduced.gray, grid, false, pixels))
      sizes.push_back(fmt::format("{}x{}", grid.width, grid.height));
  }
  return sizes;
}

}  // namespace tarsier::planar::calibration
