// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/detection.h"

#include "tarsier/core/boxes.h"
#include "tarsier/face/regression/training_face.h"

#include <algorithm>
#include <cmath>

namespace tarsier::face::landmarks {

namespace {

constexpr double kMinMatchIou = 0.4;

cv::Point2d center_of(const cv::Rect2d& box) {
  return {box.x + box.width / 2, box.y + box.height / 2};
}

}  // namespace

void DetectionEvaluator::add(const LandmarkModel& model, const FaceFinder& finder,
                             const std::vector<Candidate>& candidates,
                             const shape::BoxedImage& truth, double ms) {
  ++sum_.images;
  sum_.ms += ms;
  sum_.objects += static_cast<int>(truth.boxes.size());
  std::vector<bool> is_found(truth.boxes.size(), false);
  for (const Candidate& candidate : candidates) {
    const Eigen::Matrix2Xd start = start_at(model, finder, candidate);
    const Eigen::Vector2d center = start.rowwise().mean();
    const double side = sides_ * regression::shape_size(start);
    const cv::Rect2d box(center.x() + 0.5 - side / 2, center.y() + 0.5 - side / 2, side, side);
    bool is_right = false;
    for (std::size_t k = 0; k < truth.boxes.size() && !is_right; ++k) {
      if (is_found[k] || iou(box, truth.boxes[k]) < kMinMatchIou) continue;
      is_found[k] = true;
      is_right = true;
      ++sum_.found;
      sum_.center_error +=
          cv::norm(center_of(box) - center_of(truth.boxes[k])) / truth.boxes[k].width;
    }
    const bool is_ignored =
        std::any_of(truth.ignored.begin(), truth.ignored.end(), [&](const cv::Rect2d& ignored) {
          return (box & ignored).area() > 0.5 * std::min(box.area(), ignored.area());
        });
    if (!is_right && !is_ignored) ++sum_.false_alarms;
  }
}

DetectionScore DetectionEvaluator::score() const {
  DetectionScore score = sum_;
  score.center_error /= std::max(1, score.found);
  score.ms /= std::max(1, score.images);
  return score;
}

}  // namespace tarsier::face::landmarks
