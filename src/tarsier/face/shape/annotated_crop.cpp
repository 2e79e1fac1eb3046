// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/annotated_crop.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tarsier::face::shape {

AnnotatedCrop crop_around_points(const cv::Mat& image, const LandmarkSample& sample, double margin,
                                 int largest) {
  const Eigen::Vector2d low = sample.points.rowwise().minCoeff();
  const Eigen::Vector2d high = sample.points.rowwise().maxCoeff();
  const double side = std::max((high - low).maxCoeff(), 1.0);
  const double rim = margin * side;
  const auto bounded = [](double value, int upper) {
    return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(upper)));
  };
  cv::Rect area(cv::Point(bounded(std::floor(low.x() - rim), image.cols),
                          bounded(std::floor(low.y() - rim), image.rows)),
                cv::Point(bounded(std::ceil(high.x() + rim) + 1, image.cols),
                          bounded(std::ceil(high.y() + rim) + 1, image.rows)));
  if (area.empty()) area = cv::Rect(0, 0, image.cols, image.rows);
  const double scale = std::min(1.0, largest / side);

  AnnotatedCrop result;
  const cv::Size size(std::max(1, static_cast<int>(std::lround(area.width * scale))),
                      std::max(1, static_cast<int>(std::lround(area.height * scale))));
  if (size == area.size()) {
    result.image = image(area).clone();
  } else {
    cv::resize(image(area), result.image, size, 0, 0, cv::INTER_AREA);
  }
  const double sx = static_cast<double>(size.width) / area.width;
  const double sy = static_cast<double>(size.height) / area.height;
  result.scale = 1 / sx;
  result.points = sample.points;
  result.points.row(0) = ((sample.points.row(0).array() - area.x + 0.5) * sx - 0.5).matrix();
  result.points.row(1) = ((sample.points.row(1).array() - area.y + 0.5) * sy - 0.5).matrix();
  if (sample.box) {
    result.box = cv::Rect2d((sample.box->x - area.x + 0.5) * sx - 0.5,
                            (sample.box->y - area.y + 0.5) * sy - 0.5, sample.box->width * sx,
                            sample.box->height * sy);
  }
  return result;
}

AnnotatedCrop mirrored(const AnnotatedCrop& crop, const std::vector<int>& mirror,
                       double to_the_right) {
  LandmarkSample sample;
  sample.points = crop.points;
  sample.box = crop.box;
  LandmarkSample flipped = mirrored(sample, mirror, crop.image.cols);
  flipped.points.row(0).array() += 2 * to_the_right / crop.scale;
  AnnotatedCrop result{{}, std::move(flipped.points), flipped.box, crop.scale};
  cv::flip(crop.image, result.image, 1);
  return result;
}

}  // namespace tarsier::face::shape
