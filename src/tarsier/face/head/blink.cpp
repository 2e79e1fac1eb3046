// SPDX-License-Identifier: MIT
#include "tarsier/face/head/blink.h"

#include "tarsier/core/require.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace tarsier::face::head {
namespace {

// Outer and inner corners of the eyes.
constexpr std::array<std::array<int, 2>, 2> kCorners{{{36, 39}, {42, 45}}};
// Size of the sampled area, in distances of the corners.
constexpr double kPatchWidth = 1.1;
constexpr double kPatchHeight = 0.75;

struct Correlation {
  float low = 0;  // minimum of the two eyes
  float high = 0;
};

Correlation correlation(const EyePatches& a, const EyePatches& b) {
  const float first = a[0].dot(b[0]);
  const float second = a[1].dot(b[1]);
  return {std::min(first, second), std::max(first, second)};
}

// Positions of one eye's samples in the image: kEyeHeight x kEyeWidth, CV_32FC2.
cv::Mat sample_positions(const Eigen::Vector2d& outer, const Eigen::Vector2d& across,
                         const AffineMap& map) {
  const Eigen::Vector2d down(-across.y(), across.x());
  cv::Mat positions(kEyeHeight, kEyeWidth, CV_32FC2);
  for (int y = 0; y < kEyeHeight; ++y) {
    for (int x = 0; x < kEyeWidth; ++x) {
      const Eigen::Vector2d position =
          outer + (0.5 + kPatchWidth * ((x + 0.5) / kEyeWidth - 0.5)) * across +
          kPatchHeight * ((y + 0.5) / kEyeHeight - 0.5) * down;
      const Eigen::Vector2d at = map.leftCols<2>() * position + map.col(2);
      positions.at<cv::Vec2f>(y, x) = {static_cast<float>(at.x()), static_cast<float>(at.y())};
    }
  }
  return positions;
}

// The part of the image that contains `area`, in grey, low-pass filtered to the sampling distance.
cv::Mat smooth_part(const cv::Mat& image, const cv::Rect2d& area, double step, cv::Point& corner) {
  const double sigma = std::clamp(0.5 * step, 0.7, 16.0);
  const int margin = static_cast<int>(std::ceil(3 * sigma)) + 2;
  cv::Rect part(
      cv::Point(cvFloor(area.x) - margin, cvFloor(area.y) - margin),
      cv::Point(cvCeil(area.x + area.width) + margin, cvCeil(area.y + area.height) + margin));
  part &= cv::Rect(0, 0, image.cols, image.rows);
  if (part.empty()) return {};
  corner = part.tl();
  cv::Mat grey;
  if (image.channels() == 3)
    cv::cvtColor(image(part), grey, cv::COLOR_BGR2GRAY);
  else
    grey = image(part);
  cv::Mat smooth;
  cv::GaussianBlur(grey, smooth, {}, sigma, sigma, cv::BORDER_REPLICATE);
  return smooth;
}

}  // namespace

EyePatches eye_patches(const cv::Mat& image, const Eigen::Matrix2Xd& reference,
                       const AffineMap& map) {
  TARSIER_REQUIRE(!image.empty() && (image.type() == CV_8UC1 || image.type() == CV_8UC3),
                  "an image of 8 bits with 1 or 3 channels is needed for the eyes");
  TARSIER_REQUIRE(reference.cols() == kFacePoints, "{} points, not 68", reference.cols());
  EyePatches patches;
  for (std::size_t eye = 0; eye < patches.size(); ++eye) {
    patches[eye] = Eigen::VectorXf::Zero(kEyeWidth * kEyeHeight);
    const Eigen::Vector2d outer = reference.col(kCorners[eye][0]);
    const Eigen::Vector2d across = reference.col(kCorners[eye][1]) - outer;
    cv::Mat positions = sample_positions(outer, across, map);
    if (!cv::checkRange(positions, true, nullptr, -1e5, 1e5)) continue;
    cv::Point corner;
    const double step = (map.leftCols<2>() * across).norm() * kPatchWidth / kEyeWidth;
    const cv::Rect area = cv::boundingRect(positions.reshape(2, 1));
    const cv::Mat part = smooth_part(image, area, step, corner);
    if (part.empty()) continue;
    positions -= cv::Scalar(corner.x, corner.y);
    cv::Mat samples;
    cv::remap(part, samples, positions, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
    for (int y = 0; y < kEyeHeight; ++y)
      for (int x = 0; x < kEyeWidth; ++x) patches[eye](y * kEyeWidth + x) = samples.at<uchar>(y, x);
    patches[eye].array() -= patches[eye].mean();
    const float norm = patches[eye].norm();
    if (norm > 0) patches[eye] /= norm;
  }
  return patches;
}

bool BlinkDetector::step(double time, double lids, EyePatches eyes) {
  while (!frames_.empty() && time - frames_.front().time > options_.longest_s) frames_.pop_front();
  const Frame now{time, lids, std::move(eyes)};
  std::vector<Correlation> to_now;
  to_now.reserve(frames_.size());
  for (const Frame& frame : frames_) to_now.push_back(correlation(frame.eyes, now.eyes));
  if (to_now.size() >= 2) {
    const auto lower = [](const Correlation& a, const Correlation& b) { return a.high < b.high; };
    const auto first = to_now.begin();
    const auto shut_at = std::min_element(first + 1, to_now.end(), lower);
    const auto before_at = std::max_element(first, shut_at, lower);
    const Frame& shut = frames_[static_cast<std::size_t>(shut_at - first)];
    const Frame& before = frames_[static_cast<std::size_t>(before_at - first)];
    const double open = std::min(before.lids, now.lids);
    const double closing = open > 0 ? 1 - shut.lids / open : 0;
    const float shut_similarity = std::max(shut_at->high, correlation(before.eyes, shut.eyes).high);
    if (closing >= options_.min_closing &&
        before_at->low - shut_similarity >= options_.min_change) {
      clear();
      return true;
    }
  }
  frames_.push_back(now);
  return false;
}

}  // namespace tarsier::face::head
