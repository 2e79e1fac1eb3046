// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/simulated_views.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"
#include "tarsier/sfm/features/features.h"
#include "tarsier/sfm/features/matching.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace tarsier::sfm {
namespace {

// With these views of both images, a plane seen from the front in one and at 70 degrees in the
// other can be matched. Each further tilt costs as much again and registers no more images of
// rendered rings.
constexpr std::array kTilts{2.0};
constexpr double kAngleStep = 72 * std::numbers::pi / 180;  // of the angle, at tilt 1
constexpr double kBlurSigma = 0.8;
constexpr double kMaxCountFactor = 3;  // times max_count, for all views together
// in sigmas: neighbourhood of a feature that must be inside the image
constexpr double kNeighbourhoodSigmas = 3;
constexpr double kMaxSameFeaturePx = 0.5;   // px, max distance of features at one position
constexpr double kSameFeatureSigmas = 0.1;  // .. or this times the feature's sigma
constexpr double kCellPx = 4;               // px, of the grid; also an upper limit of that distance
// cosine above which a second descriptor is dropped
constexpr double kMaxDescriptorSimilarity = 0.95;

cv::Point2d mapped(const cv::Matx23d& map, const cv::Point2f& p) {
  const cv::Vec2d q = map * cv::Vec3d(static_cast<double>(p.x), static_cast<double>(p.y), 1);
  return {q[0], q[1]};
}

// An index of points by position.
class PointGrid {
 public:
  explicit PointGrid(cv::Size size)
      : columns_(static_cast<int>(size.width / kCellPx) + 1),
        rows_(static_cast<int>(size.height / kCellPx) + 1),
        cells_(at(columns_) * at(rows_)) {}

  void add(const cv::Point2f& position, int point) {
    cells_[at(row(static_cast<double>(position.y)) * columns_ +
              column(static_cast<double>(position.x)))]
        .push_back({position, point});
  }

  // The nearest point within `radius` <= kCellPx, the first of equally near ones; -1: none.
  [[nodiscard]] int nearest(const cv::Point2d& position, double radius) const {
    int found = -1;
    double min_distance = radius * radius;
    for (int r = row(position.y - radius); r <= row(position.y + radius); ++r) {
      for (int c = column(position.x - radius); c <= column(position.x + radius); ++c) {
        for (const Entry& entry : cells_[at(r * columns_ + c)]) {
          const cv::Point2d offset = cv::Point2d(entry.position) - position;
          const double distance = offset.dot(offset);
          if (distance > min_distance ||
              (distance == min_distance && found >= 0 && entry.point > found))
            continue;
          min_distance = distance;
          found = entry.point;
        }
      }
    }
    return found;
  }

 private:
  struct Entry {
    cv::Point2f position;
    int point;
  };
  [[nodiscard]] int column(double x) const {
    return std::clamp(static_cast<int>(x / kCellPx), 0, columns_ - 1);
  }
  [[nodiscard]] int row(double y) const {
    return std::clamp(static_cast<int>(y / kCellPx), 0, rows_ - 1);
  }
  int columns_;
  int rows_;
  std::vector<std::vector<Entry>> cells_;
};

// Whether the neighbourhood of a feature is inside the image: a circle of the view is an ellipse
// there.
bool is_inside(const cv::Point2d& position, double radius, const cv::Matx23d& map, cv::Size size) {
  const double x = radius * std::hypot(map(0, 0), map(0, 1));
  const double y = radius * std::hypot(map(1, 0), map(1, 1));
  return position.x >= x && position.y >= y && position.x <= size.width - 1 - x &&
         position.y <= size.height - 1 - y;
}

}  // namespace

std::vector<SimulatedView> simulated_views() {
  std::vector<SimulatedView> views;
  for (const double tilt : kTilts) {
    const double step = kAngleStep / tilt;
    for (int k = 0; k * step < std::numbers::pi - 1e-9; ++k) views.push_back({tilt, k * step});
  }
  return views;
}

ViewImage simulate_view(const cv::Mat& gray, const SimulatedView& view) {
  TARSIER_REQUIRE(gray.type() == CV_8UC1 && !gray.empty(), "an image of type {}", gray.type());
  TARSIER_REQUIRE(view.tilt >= 1 && view.tilt <= 16, "a tilt of {}", view.tilt);
  const double c = std::cos(view.angle);
  const double s = std::sin(view.angle);
  // Bounds of the rotated image, from the corners of its pixels.
  cv::Point2d low(1e300, 1e300);
  cv::Point2d high(-1e300, -1e300);
  for (const double x : {-0.5, gray.cols - 0.5}) {
    for (const double y : {-0.5, gray.rows - 0.5}) {
      low = {std::min(low.x, c * x - s * y), std::min(low.y, s * x + c * y)};
      high = {std::max(high.x, c * x - s * y), std::max(high.y, s * x + c * y)};
    }
  }
  const cv::Matx23d turn(c, -s, -0.5 - low.x, s, c, -0.5 - low.y);
  const cv::Size size(static_cast<int>(std::ceil(high.x - low.x - 1e-6)),
                      static_cast<int>(std::ceil(high.y - low.y - 1e-6)));
  cv::Mat turned = gray;
  if (view.angle != 0)
    cv::warpAffine(gray, turned, turn, size, cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  ViewImage result;
  cv::Matx23d whole = turn;
  if (view.tilt > 1) {
    const double sigma = kBlurSigma * std::sqrt(view.tilt * view.tilt - 1);
    const int width = 2 * static_cast<int>(std::ceil(3 * sigma)) + 1;
    cv::Mat blurred;
    cv::GaussianBlur(turned, blurred, {width, 1}, sigma, 1, cv::BORDER_REPLICATE);
    const cv::Matx23d shrink(1 / view.tilt, 0, 0.5 / view.tilt - 0.5, 0, 1, 0);
    const cv::Size narrow(std::max(1, static_cast<int>(size.width / view.tilt)), size.height);
    cv::warpAffine(blurred, result.pixels, shrink, narrow, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
    whole = cv::Matx23d(turn(0, 0) / view.tilt, turn(0, 1) / view.tilt,
                        (turn(0, 2) + 0.5) / view.tilt - 0.5, turn(1, 0), turn(1, 1), turn(1, 2));
  } else {
    result.pixels = turned;
  }
  cv::invertAffineTransform(whole, result.image_from_view);
  return result;
}

std::vector<std::int32_t> add_simulated_views(const cv::Mat& gray, const SiftOptions& options,
                                              SiftFeatures& features) {
  const std::vector<SimulatedView> views = simulated_views();
  double area = 0;
  for (const SimulatedView& view : views) area += 1 / view.tilt;
  PointGrid grid(gray.size());
  std::vector<std::vector<cv::Mat>> described(
      features.points.size());  // for the first point at each position
  for (std::size_t i = 0, first = 0; i < features.points.size(); ++i) {
    if (i == 0 || features.points[i] != features.points[first]) {
      first = i;
      grid.add(features.points[i], static_cast<int>(i));
    }
    described[first].push_back(features.descriptors.row(static_cast<int>(i)));
  }
  cv::Mat rows = features.descriptors;
  cv::Mat further;
  std::vector<std::int32_t> owners;
  for (const SimulatedView& view : views) {
    SiftOptions view_options = options;
    view_options.max_count =
        std::max(1, cvRound(kMaxCountFactor * options.max_count / view.tilt / area));
    view_options.min_count = cvRound(options.min_count / view.tilt);
    const ViewImage image = simulate_view(gray, view);
    const SiftFeatures found = find_sift(image.pixels, view_options);
    for (std::size_t k = 0; k < found.points.size(); ++k) {
      const double sigma = static_cast<double>(found.sizes[k]) / 2;
      const cv::Point2d position = mapped(image.image_from_view, found.points[k]);
      if (!is_inside(position, kNeighbourhoodSigmas * sigma, image.image_from_view, gray.size()))
        continue;
      // radius of a circle with the ellipse's area
      const double mean_sigma = sigma * std::sqrt(view.tilt);
      const double radius =
          std::min(kCellPx, std::max(kMaxSameFeaturePx, kSameFeatureSigmas * mean_sigma));
      const cv::Mat descriptor = found.descriptors.row(static_cast<int>(k));
      const int point = grid.nearest(position, radius);
      if (point < 0) {
        const cv::Point2f point_position(position);
        grid.add(point_position, static_cast<int>(features.points.size()));
        features.points.push_back(point_position);
        features.sizes.push_back(static_cast<float>(2 * mean_sigma));
        described.push_back({descriptor});
        rows.push_back(descriptor);
        continue;
      }
      std::vector<cv::Mat>& known = described[at(point)];
      if (std::any_of(known.begin(), known.end(), [&](const cv::Mat& one) {
            return similarity(one, 0, descriptor, 0, FeatureKind::kSift) > kMaxDescriptorSimilarity;
          }))
        continue;
      known.push_back(descriptor);
      further.push_back(descriptor);
      owners.push_back(point);
    }
  }
  if (!further.empty()) rows.push_back(further);
  features.descriptors = rows;
  return owners;
}

}  // namespace tarsier::sfm
