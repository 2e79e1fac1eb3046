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

constexpr Eigen::Index kPoints = 68;
// Outer and inner corners of the eyes.
constexpr std::array<std::array<int, 2>, 2> kCorners{{{36, 39}, {42, 45}}};
// Sides of what is sampled, in distances of the corners.
constexpr double kWide = 1.1;
constexpr double kHigh = 0.75;

struct Correlation {
  float low = 0;  // of the two eyes
  float high = 0;
};

Correlation correlation(const EyeLook& a, const EyeLook& b) {
  const float first = a[0].dot(b[0]);
  const float second = a[1].dot(b[1]);
  return {std::min(first, second), std::max(first, second)};
}

// The part of the image that holds `area`, in grey and without what is finer than the samples.
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

EyeLook look_of_eyes(const cv::Mat& image, const Eigen::Matrix2Xd& reference,
                     const AffineMap& map) {
  TARSIER_REQUIRE(!image.empty() && (image.type() == CV_8UC1 || image.type() == CV_8UC3),
                  "an image of 8 bits with 1 or 3 channels is needed for the eyes");
  TARSIER_REQUIRE(reference.cols() == kPoints, "{} points, not 68", reference.cols());
  EyeLook look;
  for (std::size_t eye = 0; eye < look.size(); ++eye) {
    look[eye] = Eigen::VectorXf::Zero(kEyeWidth * kEyeHeight);
    const Eigen::Vector2d outer = reference.col(kCorners[eye][0]);
    const Eigen::Vector2d across = reference.col(kCorners[eye][1]) - outer;
    const Eigen::Vector2d down(-across.y(), across.x());
    cv::Mat places(kEyeHeight, kEyeWidth, CV_32FC2);
    for (int y = 0; y < kEyeHeight; ++y) {
      for (int x = 0; x < kEyeWidth; ++x) {
        const Eigen::Vector2d place = outer +
                                      (0.5 + kWide * ((x + 0.5) / kEyeWidth - 0.5)) * across +
                                      kHigh * ((y + 0.5) / kEyeHeight - 0.5) * down;
        const Eigen::Vector2d at = map.leftCols<2>() * place + map.col(2);
        places.at<cv::Vec2f>(y, x) = {static_cast<float>(at.x()), static_cast<float>(at.y())};
      }
    }
    if (!cv::checkRange(places, true, nullptr, -1e5, 1e5)) continue;
    cv::Point corner;
    const double step = (map.leftCols<2>() * across).norm() * kWide / kEyeWidth;
    const cv::Rect area = cv::boundingRect(places.reshape(2, 1));
    const cv::Mat part = smooth_part(image, area, step, corner);
    if (part.empty()) continue;
    places -= cv::Scalar(corner.x, corner.y);
    cv::Mat samples;
    cv::remap(part, samples, places, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
    for (int y = 0; y < kEyeHeight; ++y)
      for (int x = 0; x < kEyeWidth; ++x) look[eye](y * kEyeWidth + x) = samples.at<uchar>(y, x);
    look[eye].array() -= look[eye].mean();
    const float norm = look[eye].norm();
    if (norm > 0) look[eye] /= norm;
  }
  return look;
}

bool BlinkDetector::step(double time, double lids, EyeLook eyes) {
  while (!frames_.empty() && time - frames_.front().time > options_.longest_s) frames_.pop_front();
  const Seen now{time, lids, std::move(eyes)};
  std::vector<Correlation> to_now;
  to_now.reserve(frames_.size());
  for (const Seen& frame : frames_) to_now.push_back(correlation(frame.eyes, now.eyes));
  std::size_t shut = 0;
  for (std::size_t i = 1; i < frames_.size(); ++i)
    if (to_now[i].high < to_now[shut].high || shut == 0) shut = i;
  std::size_t before = 0;
  for (std::size_t i = 1; i < shut; ++i)
    if (to_now[i].high > to_now[before].high) before = i;
  if (shut > 0) {
    const double open = std::min(frames_[before].lids, now.lids);
    const double closing = open > 0 ? 1 - frames_[shut].lids / open : 0;
    const float unlike =
        std::max(to_now[shut].high, correlation(frames_[before].eyes, frames_[shut].eyes).high);
    if (closing >= options_.min_closing && to_now[before].low - unlike >= options_.min_change) {
      clear();
      return true;
    }
  }
  frames_.push_back(now);
  return false;
}

}  // namespace tarsier::face::head
