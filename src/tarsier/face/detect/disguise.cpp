// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/disguise.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace tarsier::face::training {
namespace {

// The face's axes in the view: positions of the eyes, their distance, the directions right and
// down.
struct FaceAxes {
  cv::Point2d left, right, across, down;
  double eyes = 0;
  [[nodiscard]] cv::Point2d at(const cv::Point2d& from, double x, double y) const {
    return from + eyes * (x * across + y * down);
  }
};

cv::Point2d mean_of(const std::vector<cv::Point2d>& points, std::size_t first, std::size_t last) {
  cv::Point2d sum;
  for (std::size_t i = first; i <= last; ++i) sum += points[i];
  return sum * (1.0 / static_cast<double>(last - first + 1));
}

FaceAxes axes_of(const std::vector<cv::Point2d>& points) {
  FaceAxes axes;
  axes.left = mean_of(points, 36, 41);
  axes.right = mean_of(points, 42, 47);
  const cv::Point2d mouth = mean_of(points, 48, 59);
  const cv::Point2d down = mouth - (axes.left + axes.right) * 0.5;
  // The eyes of turned heads are close together, so the height of the face is used too.
  axes.eyes = std::max({2.0, cv::norm(axes.right - axes.left), 0.8 * cv::norm(down)});
  axes.down = down * (1 / std::max(1e-9, cv::norm(down)));
  axes.across = {axes.down.y, -axes.down.x};
  if (axes.across.dot(axes.right - axes.left) < 0) axes.across *= -1;
  return axes;
}

// Shapes are drawn with sub-pixel coordinates, measured from the corners of pixels.
constexpr int kShift = 4;
cv::Point fixed(const cv::Point2d& p) {
  const double unit = 1 << kShift;
  return {cvRound((p.x - 0.5) * unit), cvRound((p.y - 0.5) * unit)};
}

void fill(cv::Mat& mask, const std::vector<cv::Point2d>& outline, double value = 255) {
  std::vector<cv::Point> corners;
  corners.reserve(outline.size());
  for (const cv::Point2d& p : outline) corners.push_back(fixed(p));
  cv::fillPoly(mask, std::vector<std::vector<cv::Point>>{corners}, cv::Scalar(value), cv::LINE_AA,
               kShift);
}

void fill_ellipse(cv::Mat& mask, const FaceAxes& axes, const cv::Point2d& center, double rx,
                  double ry) {
  std::vector<cv::Point2d> outline;
  for (int k = 0; k < 24; ++k) {
    const double angle = k * CV_PI / 12;
    outline.push_back(axes.at(center, rx * std::cos(angle), ry * std::sin(angle)));
  }
  fill(mask, outline);
}

// view = (1 - m) view + m (gain view + paint), m = opacity * mask / 255.
void blend(cv::Mat& view, const cv::Mat& mask, const cv::Mat& paint, double gain, double opacity) {
  for (int y = 0; y < view.rows; ++y) {
    std::uint8_t* row = view.ptr(y);
    const std::uint8_t* cover = mask.ptr(y);
    const auto* tone = paint.ptr<float>(y);
    for (int x = 0; x < view.cols; ++x) {
      const double m = opacity * cover[x] / 255;
      row[x] = cv::saturate_cast<std::uint8_t>((1 - m) * row[x] + m * (gain * row[x] + tone[x]));
    }
  }
}

// A tone with a gradient over the view and grain; or the texture.
cv::Mat paint_of(const cv::Mat& texture, double tone, double grain, bool textured, Rng& rng) {
  cv::Mat paint(texture.size(), CV_32F);
  const double slope = rng.normal(0, 0.6);
  for (int y = 0; y < paint.rows; ++y) {
    for (int x = 0; x < paint.cols; ++x) {
      const double shade = textured ? texture.at<std::uint8_t>(y, x) : tone;
      const double noise = grain > 0 ? rng.normal(0, grain) : 0;
      paint.at<float>(y, x) = static_cast<float>(shade + slope * (y - paint.rows / 2) + noise);
    }
  }
  return paint;
}

void wear_glasses(cv::Mat& view, const std::vector<cv::Point2d>& points, const FaceAxes& axes,
                  const cv::Mat& texture, Rng& rng) {
  const double rx = rng.uniform(0.3, 0.47);
  const double ry = rng.uniform(0.2, 0.38);
  const double low = rng.uniform(-0.02, 0.12);
  const bool square = rng.uniform() < 0.4;
  cv::Mat mask(view.size(), CV_8UC1, cv::Scalar(0));
  for (const cv::Point2d& eye : {axes.left, axes.right}) {
    const cv::Point2d center = axes.at(eye, 0, low);
    if (square) {
      fill(mask, {axes.at(center, -rx, -ry), axes.at(center, rx, -ry),
                  axes.at(center, 0.8 * rx, ry), axes.at(center, -0.8 * rx, ry)});
    } else {
      fill_ellipse(mask, axes, center, rx, ry);
    }
  }
  // The bridge and the temples of the glasses.
  const double thick = rng.uniform(0.02, 0.06);
  const double high = low - rng.uniform(0, 0.6) * ry;
  const auto bar = [&](const cv::Point2d& a, const cv::Point2d& b) {
    fill(mask, {axes.at(a, 0, -thick), axes.at(b, 0, -thick), axes.at(b, 0, thick),
                axes.at(a, 0, thick)});
  };
  bar(axes.at(axes.left, 0, high), axes.at(axes.right, 0, high));
  bar(axes.at(axes.left, 0, high), points[0]);
  bar(axes.at(axes.right, 0, high), points[16]);
  const double tone = rng.uniform() < 0.8 ? rng.uniform(0, 70) : rng.uniform(70, 220);
  const bool textured = rng.uniform() < 0.2;  // reflection of the surroundings
  const cv::Mat paint = paint_of(texture, tone, 0, textured, rng);
  blend(view, mask, paint, 0, rng.uniform(0.7, 1));
}

void wear_cap(cv::Mat& view, const std::vector<cv::Point2d>& points, const FaceAxes& axes,
              const cv::Mat& texture, Rng& rng) {
  const double height = rng.uniform(0.7, 1.6);
  const double lift = rng.uniform(-0.12, 0.4);  // from the eyebrows up to its edge
  std::vector<cv::Point2d> outline;
  const cv::Point2d left = axes.at(points[0], -0.12, -0.1 - lift);
  const cv::Point2d right = axes.at(points[16], 0.12, -0.1 - lift);
  const cv::Point2d brow = axes.at((points[19] + points[24]) * 0.5, 0, -lift);
  outline.push_back(left);
  outline.push_back(axes.at(left, 0.05, -0.6 * height));
  outline.push_back(axes.at(brow, -0.5, -height));
  outline.push_back(axes.at(brow, 0.5, -height));
  outline.push_back(axes.at(right, -0.05, -0.6 * height));
  outline.push_back(right);
  outline.push_back(axes.at(brow, 0.4, 0));
  outline.push_back(axes.at(brow, -0.4, 0));
  // Draw its shadow first.
  cv::Mat mask(view.size(), CV_8UC1, cv::Scalar(0));
  const cv::Mat nothing(view.size(), CV_32F, cv::Scalar(0));
  if (rng.uniform() < 0.6) {
    const double deep = lift + rng.uniform(0.1, 0.7);
    fill(mask, {left, right, axes.at(right, -0.1, deep), axes.at(left, 0.1, deep)});
    blend(view, mask, nothing, rng.uniform(0.35, 0.85), 1);
    mask.setTo(0);
  }
  fill(mask, outline);
  const double tone = rng.uniform(5, 245);
  const bool textured = rng.uniform() < 0.25;
  blend(view, mask, paint_of(texture, tone, 3, textured, rng), 0, 1);
  if (rng.uniform() < 0.7) {  // the visor
    mask.setTo(0);
    const double dx = rng.normal(0, 0.15);
    const double dy = rng.uniform(-0.15, 0.05);
    const double wide = rng.uniform(0.6, 1.1);
    fill_ellipse(mask, axes, axes.at(brow, dx, dy), wide, rng.uniform(0.06, 0.26));
    const double visor = rng.uniform(5, 245);
    blend(view, mask, paint_of(texture, visor, 2, false, rng), 0, 1);
  }
}

void wear_beard(cv::Mat& view, const std::vector<cv::Point2d>& points, const FaceAxes& axes,
                const cv::Mat& texture, Rng& rng) {
  std::vector<cv::Point2d> outline(points.begin() + 2, points.begin() + 15);
  const double longer = rng.uniform(0, 0.3);
  for (std::size_t i = 3; i < 10; ++i) outline[i] = axes.at(outline[i], 0, longer);
  const double cheek = rng.uniform(0.2, 0.8);  // where it starts on the cheeks
  outline.push_back(points[13] * (1 - cheek) + points[54] * cheek);
  outline.push_back(axes.at(points[35], 0.05, 0.08));
  outline.push_back(axes.at(points[33], 0, 0.1));
  outline.push_back(axes.at(points[31], -0.05, 0.08));
  outline.push_back(points[3] * (1 - cheek) + points[48] * cheek);
  cv::Mat mask(view.size(), CV_8UC1, cv::Scalar(0));
  fill(mask, outline);
  if (rng.uniform() < 0.7) fill(mask, {points.begin() + 48, points.begin() + 60}, 0);
  const double grain = rng.uniform(2, 12);
  const double tone = rng.uniform(0, 40);
  const cv::Mat paint = paint_of(texture, tone, grain, false, rng);
  const double skin = rng.uniform(0.1, 0.45);  // skin that shows through
  blend(view, mask, paint, skin, rng.uniform(0.6, 1));
}

// Draws a hand, a racket or a microphone.
void hold_object(cv::Mat& view, const std::vector<cv::Point2d>& points, const FaceAxes& axes,
                 const cv::Mat& texture, Rng& rng) {
  const auto where = static_cast<std::size_t>(rng.integer(0, 67));
  const double dx = rng.normal(0, 0.3);
  const cv::Point2d center = axes.at(points[where], dx, rng.uniform(0, 0.5));
  cv::Mat mask(view.size(), CV_8UC1, cv::Scalar(0));
  if (rng.uniform() < 0.6) {
    const double rx = rng.uniform(0.2, 0.6);
    fill_ellipse(mask, axes, center, rx, rng.uniform(0.2, 0.6));
  } else {
    const double angle = rng.uniform(0, CV_PI);
    const cv::Point2d along(std::cos(angle), std::sin(angle));
    const cv::Point2d normal(-along.y, along.x);
    const double length = axes.eyes * rng.uniform(0.5, 3);
    const double width = axes.eyes * rng.uniform(0.05, 0.3);
    fill(mask,
         {center - along * length - normal * width, center + along * length - normal * width,
          center + along * length + normal * width, center - along * length + normal * width});
  }
  const double skin =
      view.at<std::uint8_t>(std::clamp(cvRound(points[30].y - 0.5), 0, view.rows - 1),
                            std::clamp(cvRound(points[30].x - 0.5), 0, view.cols - 1));
  const double tone = rng.uniform() < 0.6 ? skin + rng.normal(0, 20) : rng.uniform(0, 255);
  const bool textured = rng.uniform() < 0.3;
  blend(view, mask, paint_of(texture, tone, 4, textured, rng), 0, 1);
}

void wear_hair(cv::Mat& view, const std::vector<cv::Point2d>& points, const FaceAxes& axes,
               const cv::Mat& texture, Rng& rng) {
  const bool left = rng.uniform() < 0.5;
  const double side = left ? -1 : 1;
  const double into = rng.uniform(0.05, 0.55);
  const cv::Point2d high = axes.at(points[left ? 17 : 26], 0, -0.7);
  const cv::Point2d low = axes.at(points[left ? 4 : 12], 0, rng.uniform(0, 0.8));
  cv::Mat mask(view.size(), CV_8UC1, cv::Scalar(0));
  fill(mask, {axes.at(high, 0.3 * side, 0), axes.at(high, -into * side, 0),
              axes.at(points[left ? 1 : 15], -into * side, rng.normal(0, 0.2)),
              axes.at(low, -0.5 * into * side, 0), axes.at(low, 0.5 * side, 0)});
  const double grain = rng.uniform(4, 22);
  const double tone = rng.uniform() < 0.7 ? rng.uniform(5, 80) : rng.uniform(80, 220);
  const cv::Mat paint = paint_of(texture, tone, grain, false, rng);
  blend(view, mask, paint, 0, rng.uniform(0.8, 1));
}

}  // namespace

void disguise(cv::Mat& view, const std::vector<cv::Point2d>& points, const cv::Mat& texture,
              Rng& rng) {
  using Wear =
      void (*)(cv::Mat&, const std::vector<cv::Point2d>&, const FaceAxes&, const cv::Mat&, Rng&);
  constexpr Wear kKinds[] = {wear_beard,   wear_hair, wear_glasses,
                             wear_glasses, wear_cap,  hold_object};
  const FaceAxes axes = axes_of(points);
  const int first = rng.integer(0, 5);
  kKinds[first](view, points, axes, texture, rng);
  if (rng.uniform() < 0.4) {
    const int second = rng.integer(0, 5);
    if (second != first) kKinds[second](view, points, axes, texture, rng);
  }
}

}  // namespace tarsier::face::training
