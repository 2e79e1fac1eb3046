// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/occlusion.h"

#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/face/regression/training_face.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::face::regression {
namespace {

constexpr int kFractionBits = 4;  // of the coordinates of cv::fillPoly

void fill(cv::Mat& mask, const std::vector<Eigen::Vector2d>& outline) {
  std::vector<cv::Point> corners;
  corners.reserve(outline.size());
  for (const Eigen::Vector2d& p : outline)
    corners.emplace_back(cvRound(p.x() * (1 << kFractionBits)),
                         cvRound(p.y() * (1 << kFractionBits)));
  cv::fillPoly(mask, std::vector<std::vector<cv::Point>>{corners}, cv::Scalar(255), cv::LINE_AA,
               kFractionBits);
}

// Mask of the occlusion, 0..255, around `center`; `reach` px is half its size.
cv::Mat draw_mask(cv::Size size, const Eigen::Vector2d& center, double reach, Rng& rng) {
  cv::Mat mask(size, CV_8UC1, cv::Scalar(0));
  const double turn = rng.uniform(0, 2 * CV_PI);
  const double narrow = rng.uniform(0.35, 1.0);  // short side / long side
  const Eigen::Vector2d along(std::cos(turn), std::sin(turn));
  const Eigen::Vector2d across(-along.y(), along.x());
  const auto at = [&](double x, double y) -> Eigen::Vector2d {
    return center + reach * (x * along + narrow * y * across);
  };
  const int kind = rng.integer(0, 3);
  std::vector<Eigen::Vector2d> outline;
  if (kind == 0) {  // one side of a line
    constexpr double kBeyondFace = 20;
    outline = {at(0, -kBeyondFace), at(0, kBeyondFace), at(kBeyondFace, kBeyondFace),
               at(kBeyondFace, -kBeyondFace)};
  } else if (kind == 1) {
    outline = {at(-1, -1), at(1, -1), at(1, 1), at(-1, 1)};
  } else {
    constexpr int kCorners = 24;
    const double uneven = kind == 2 ? 0 : rng.uniform(0.1, 0.4);
    for (int k = 0; k < kCorners; ++k) {
      const double angle = 2 * CV_PI * k / kCorners;
      const double radius = 1 + uneven * rng.uniform(-1, 1);
      outline.push_back(at(radius * std::cos(angle), radius * std::sin(angle)));
    }
  }
  fill(mask, outline);
  return mask;
}

cv::Mat draw_surface(cv::Size size, const cv::Mat& texture, Rng& rng) {
  cv::Mat surface(size, CV_8UC1, cv::Scalar(rng.uniform(5, 250)));
  const int kind = rng.integer(0, 3);
  if (kind == 1) {  // a part of the texture
    const int side = std::min({texture.cols, texture.rows, rng.integer(8, 200)});
    const int y = rng.integer(0, texture.rows - side);
    const int x = rng.integer(0, texture.cols - side);
    const cv::Rect part(x, y, side, side);
    cv::resize(texture(part), surface, size, 0, 0, cv::INTER_LINEAR);
  } else if (kind == 2) {  // stripes
    const double turn = rng.uniform(0, CV_PI);
    const double period = rng.uniform(4, 40);
    const double height = rng.uniform(5, 60);
    const double tone = rng.uniform(40, 215);
    for (int y = 0; y < size.height; ++y)
      for (int x = 0; x < size.width; ++x)
        surface.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(
            tone +
            height * std::sin(2 * CV_PI * (x * std::cos(turn) + y * std::sin(turn)) / period));
  }
  const double noise = kind == 3 ? rng.uniform(5, 40) : rng.uniform(0, 4);
  if (noise > 0.5) {
    // The sum of two uniform numbers is close enough to normal, and fast.
    const double reach = noise * std::sqrt(1.5);
    cv::Mat grain(size, CV_32FC1);
    for (int y = 0; y < size.height; ++y)
      for (int x = 0; x < size.width; ++x)
        grain.at<float>(y, x) =
            static_cast<float>(reach * (rng.uniform(-1, 1) + rng.uniform(-1, 1)));
    if (kind == 3) cv::GaussianBlur(grain, grain, {}, rng.uniform(0.3, 3));
    cv::add(surface, grain, surface, cv::noArray(), CV_8U);
  }
  return surface;
}

}  // namespace

std::vector<bool> draw_occlusion(cv::Mat& gray, const Eigen::Matrix2Xd& points,
                                 const cv::Mat& texture, Rng& rng) {
  require_gray(gray);
  require_gray(texture);
  TARSIER_REQUIRE(points.cols() > 0 && points.allFinite(), "{} points", points.cols());
  TARSIER_REQUIRE(texture.cols >= 8 && texture.rows >= 8, "a texture of {} x {} px", texture.cols,
                  texture.rows);
  const double size = shape_size(points);
  constexpr int kDraws = 100;
  double larger = 1;
  while (true) {
    cv::Mat mask;
    std::vector<bool> hidden(static_cast<std::size_t>(points.cols()));
    for (int draw = 0; draw < kDraws; ++draw) {
      const Eigen::Vector2d at = points.col(rng.integer(0, static_cast<int>(points.cols()) - 1));
      const double dx = rng.normal(0, 0.3);
      const double dy = rng.normal(0, 0.3);
      const Eigen::Vector2d center = at + size * Eigen::Vector2d(dx, dy);
      mask = draw_mask(gray.size(), center, larger * size * rng.uniform(0.25, 1.1), rng);
      int count = 0;
      for (Eigen::Index p = 0; p < points.cols(); ++p) {
        const cv::Point there(cvRound(points(0, p)), cvRound(points(1, p)));
        const bool is_hidden =
            cv::Rect({}, mask.size()).contains(there) && mask.at<std::uint8_t>(there) >= 128;
        hidden[static_cast<std::size_t>(p)] = is_hidden;
        count += is_hidden ? 1 : 0;
      }
      // Skip occlusions that hide nearly the whole face.
      if (count == 0 || count > 0.7 * static_cast<double>(points.cols())) continue;
      cv::GaussianBlur(mask, mask, {}, rng.uniform(0.3, 1.5));
      const cv::Rect part = cv::boundingRect(mask);
      const cv::Mat surface = draw_surface(part.size(), texture, rng);
      cv::Mat drawn = gray(part);
      const cv::Mat shares = mask(part);
      for (int y = 0; y < part.height; ++y) {
        for (int x = 0; x < part.width; ++x) {
          const int share = shares.at<std::uint8_t>(y, x);
          auto& pixel = drawn.at<std::uint8_t>(y, x);
          pixel = static_cast<std::uint8_t>(
              (share * surface.at<std::uint8_t>(y, x) + (255 - share) * pixel + 127) / 255);
        }
      }
      return hidden;
    }
    larger *= 1.5;
    TARSIER_REQUIRE(larger < 100, "no point lies in the image");
  }
}

}  // namespace tarsier::face::regression
