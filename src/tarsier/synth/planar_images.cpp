// SPDX-License-Identifier: MIT
#include "tarsier/synth/planar_images.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/synth/noise.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::synth {
namespace {

cv::Scalar random_paint(Rng& rng, double min_level = 10, double max_level = 245) {
  // Most objects are greyish; some are colourful.
  const double level = rng.uniform(min_level, max_level);
  const double spread = rng.uniform() < 0.7 ? 15 : 65;
  const auto channel = [&] {
    return std::clamp(level + rng.uniform(-spread, spread), min_level, max_level);
  };
  const double blue = channel();
  const double green = channel();
  return {blue, green, channel()};
}

cv::Point random_point(Rng& rng, cv::Size size) {
  const int x = rng.integer(-size.width / 10, size.width + size.width / 10);
  return {x, rng.integer(-size.height / 10, size.height + size.height / 10)};
}

void fill_box(cv::Mat& image, const cv::RotatedRect& box, const cv::Scalar& color) {
  std::array<cv::Point2f, 4> corners;
  box.points(corners.data());
  std::array<cv::Point, 4> points;
  for (std::size_t k = 0; k < 4; ++k) points[k] = corners[k];
  cv::fillConvexPoly(image, points.data(), 4, color, cv::LINE_AA);
}

// Smooth noise at scales from `coarsest` px to 2 px, with amplitudes that fall with the scale.
void add_grain(cv::Mat& image, double coarsest, double amplitude, Rng& rng) {
  cv::Mat sum = cv::Mat::zeros(image.size(), CV_32FC1);
  double weight = amplitude;
  for (double scale = coarsest; scale >= 2; scale /= 2) {
    const cv::Size small(std::max(2, cvCeil(image.cols / scale)),
                         std::max(2, cvCeil(image.rows / scale)));
    cv::Mat coarse(small, CV_32FC1);
    for (int y = 0; y < small.height; ++y)
      for (int x = 0; x < small.width; ++x)
        coarse.at<float>(y, x) = static_cast<float>(rng.uniform(-weight, weight));
    cv::Mat fine;
    cv::resize(coarse, fine, image.size(), 0, 0, cv::INTER_LINEAR);
    sum += fine;
    weight *= 0.72;
  }
  for (int y = 0; y < image.rows; ++y) {
    auto* row = image.ptr<cv::Vec3b>(y);
    const auto* more = sum.ptr<float>(y);
    for (int x = 0; x < image.cols; ++x)
      for (int c = 0; c < 3; ++c)
        row[x][c] = cv::saturate_cast<uchar>(static_cast<float>(row[x][c]) + more[x]);
  }
}

// Lines of words on a sheet of paper.
void draw_sheet(cv::Mat& image, const cv::Point2f& at, float length, float angle, Rng& rng) {
  const float width = 0.7F * length;
  const auto paper = static_cast<double>(rng.integer(200, 245));
  fill_box(image, {at, {width, length}, angle}, cv::Scalar::all(paper));
  const float turn = angle * static_cast<float>(CV_PI / 180);
  const cv::Point2f right(std::cos(turn), std::sin(turn));
  const cv::Point2f down(-right.y, right.x);
  const cv::Scalar ink = cv::Scalar::all(rng.integer(10, 90));
  const int lines = rng.integer(6, 22);
  for (int i = 0; i < lines; ++i) {
    const float y =
        length * (0.84F * (static_cast<float>(i) + 0.5F) / static_cast<float>(lines) - 0.42F);
    float x = -0.42F * width;
    while (x < 0.4F * width) {
      const auto word = static_cast<float>(rng.uniform(0.03, 0.16)) * width;
      const float max_width = std::min(word, 0.42F * width - x);
      const cv::Point2f center = at + (x + max_width / 2) * right + y * down;
      fill_box(image, {center, {max_width, 0.35F * length / static_cast<float>(lines)}, angle},
               ink);
      x += word + 0.02F * width;
    }
  }
}

// A facade: rows of dark windows in light frames.
void draw_windows(cv::Mat& image, const cv::Rect& box, Rng& rng) {
  const cv::Scalar wall = random_paint(rng, 90, 220);
  const cv::Scalar frame = random_paint(rng, 170, 250);
  const cv::Scalar glass = random_paint(rng, 8, 70);
  cv::rectangle(image, box, wall, cv::FILLED);
  const int columns = rng.integer(2, 7);
  const int rows = rng.integer(1, 5);
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      const cv::Rect cell(box.x + i * box.width / columns, box.y + j * box.height / rows,
                          box.width / columns, box.height / rows);
      const cv::Rect outer(cell.x + cell.width / 5, cell.y + cell.height / 6, 3 * cell.width / 5,
                           2 * cell.height / 3);
      cv::rectangle(image, outer, frame, cv::FILLED);
      const int rim = std::max(1, outer.width / 8);
      const cv::Rect inner(outer.x + rim, outer.y + rim, outer.width - 2 * rim,
                           outer.height - 2 * rim);
      if (inner.width > 1 && inner.height > 1) cv::rectangle(image, inner, glass, cv::FILLED);
    }
  }
}

// Boards of wood, tiles, or one colour.
void draw_surface(cv::Mat& image, Rng& rng) {
  const int kind = rng.integer(0, 3);
  const cv::Scalar base = random_paint(rng, 70, 200);
  image.setTo(base);
  const int size = image.cols;
  if (kind <= 1) {
    const int pitch = rng.integer(size / 12, size / 4);
    for (int at = 0; at < size; at += pitch) {
      const double lighter = rng.uniform(0.8, 1.15);
      cv::rectangle(image, cv::Rect(at, 0, pitch, size), base * lighter, cv::FILLED);
      cv::line(image, {at, 0}, {at, size}, base * 0.5, std::max(1, size / 400));
      for (int i = 0; i < 30; ++i) {
        const int x = at + rng.integer(2, std::max(3, pitch - 2));
        const int y = rng.integer(0, size);
        const cv::Point to{x + rng.integer(-6, 6), y + rng.integer(size / 20, size / 4)};
        const double darker = rng.uniform(0.75, 1.1);
        const int thick = 1 + rng.integer(0, size / 400);
        cv::line(image, {x, y}, to, base * darker, thick, cv::LINE_AA);
      }
      if (kind == 1) cv::line(image, {0, at}, {size, at}, base * 0.55, std::max(1, size / 300));
    }
  }
  add_grain(image, size / 3.0, 12, rng);
}

void draw_object(cv::Mat& image, Rng& rng) {
  const cv::Size size = image.size();
  const double larger = size.width;
  const cv::Point at = random_point(rng, size);
  const cv::Scalar color = random_paint(rng);
  const auto angle = static_cast<float>(rng.uniform(0, 360));
  const auto length = static_cast<float>(larger * rng.uniform(0.03, 0.2));
  switch (rng.integer(0, 7)) {
    case 0:  // a pen
      fill_box(image, {cv::Point2f(at), {length, length * 0.07F}, angle}, color);
      break;
    case 1:
      cv::circle(image, at, cvRound(0.4F * length), color, cv::FILLED, cv::LINE_AA);
      cv::circle(image, at, cvRound(0.28F * length), color * 0.8, cv::FILLED, cv::LINE_AA);
      break;
    case 2:
      draw_sheet(image, at, 2 * length, angle, rng);
      break;
    case 3:
      draw_windows(image, {at.x, at.y, cvRound(2 * length), cvRound(1.4F * length)}, rng);
      break;
    case 4: {  // dark squares on white that resemble markers
      const auto side = length * 0.6F;
      fill_box(image, {cv::Point2f(at), {side * 1.3F, side * 1.3F}, angle}, {235, 235, 235});
      fill_box(image, {cv::Point2f(at), {side, side}, angle}, {25, 25, 25});
      if (rng.uniform() < 0.6)
        fill_box(image, {cv::Point2f(at), {side * 0.5F, side * 0.4F}, angle}, {220, 220, 220});
      break;
    }
    case 5: {  // leaves
      for (int i = 0; i < 25; ++i) {
        const cv::Point leaf{at.x + cvRound(rng.normal(0, 0.5) * static_cast<double>(length)),
                             at.y + cvRound(rng.normal(0, 0.5) * static_cast<double>(length))};
        const cv::Size axes(std::max(1, cvRound(length * 0.12F)),
                            std::max(1, cvRound(length * 0.05F)));
        const double turn = rng.uniform(0, 360);
        const cv::Scalar green{rng.uniform(10, 80), rng.uniform(60, 200), rng.uniform(20, 120)};
        cv::ellipse(image, leaf, axes, turn, 0, 360, green, cv::FILLED, cv::LINE_AA);
      }
      break;
    }
    case 6: {  // a cable
      cv::Point last = at;
      double heading = rng.uniform(0, 2 * CV_PI);
      for (int i = 0; i < 24; ++i) {
        heading += rng.normal(0, 0.35);
        const cv::Point next(
            last.x + cvRound(0.2 * static_cast<double>(length) * std::cos(heading)),
            last.y + cvRound(0.2 * static_cast<double>(length) * std::sin(heading)));
        cv::line(image, last, next, color, std::max(1, cvRound(0.03F * length)), cv::LINE_AA);
        last = next;
      }
      break;
    }
    default:
      fill_box(image, {cv::Point2f(at), {length * 1.5F, length}, angle}, color);
      fill_box(image, {cv::Point2f(at), {length * 1.2F, length * 0.6F}, angle}, random_paint(rng));
      break;
  }
}

}  // namespace

cv::Mat marker_image(const planar::markers::Dictionary& family, int id, int cell_px) {
  TARSIER_REQUIRE(cell_px >= 1 && cell_px <= 256, "cells of {} px", cell_px);
  const planar::markers::Code code = family.code(id);
  const int n = family.cells();
  cv::Mat cells(n + 4, n + 4, CV_8UC1, cv::Scalar(235));
  cells(cv::Rect(1, 1, n + 2, n + 2)).setTo(22);
  for (int k = 0; k < n * n; ++k)
    if ((code >> (n * n - 1 - k) & 1U) != 0) cells.at<uchar>(2 + k / n, 2 + k % n) = 235;
  cv::Mat image;
  cv::resize(cells, image, {}, cell_px, cell_px, cv::INTER_NEAREST);
  return image;
}

PlanarPrint marker_print(const planar::markers::Dictionary& family, int id, double side) {
  constexpr int kCell = 24;
  PlanarPrint print;
  print.id = id;
  print.name = family.name();
  print.image = marker_image(family, id, kCell);
  const double black = kCell * (family.cells() + 2);
  print.part = {kCell, kCell, black, black};
  print.width = side;
  return print;
}

cv::Mat poster_image(cv::Size size, std::uint64_t seed) {
  TARSIER_REQUIRE(
      size.width >= 16 && size.height >= 16 && size.width <= 4096 && size.height <= 4096,
      "{}x{} px", size.width, size.height);
  Rng rng(seed ^ 0x90573e5ULL);
  cv::Mat image(size, CV_8UC3, random_paint(rng));
  const double larger = std::max(size.width, size.height);
  // From large to small.
  for (int i = 0; i < 260; ++i) {
    const double scale = larger * 0.35 * std::pow(0.05, i / 260.0) * rng.uniform(0.5, 1.5);
    const cv::Point at = random_point(rng, size);
    const cv::Scalar color = random_paint(rng);
    const double angle = rng.uniform(0, 360);
    const int radius = std::max(1, cvRound(0.5 * scale));
    switch (rng.integer(0, 4)) {
      case 0:
        cv::ellipse(image, at, {radius, std::max(1, cvRound(radius * rng.uniform(0.3, 1.0)))},
                    angle, 0, 360, color, cv::FILLED, cv::LINE_AA);
        break;
      case 1:
        cv::ellipse(image, at, {radius, radius}, angle, 0, rng.uniform(60, 300), color,
                    std::max(1, radius / 5), cv::LINE_AA);
        break;
      case 2:
        fill_box(image,
                 {cv::Point2f(at),
                  {static_cast<float>(scale), static_cast<float>(scale * rng.uniform(0.2, 1.0))},
                  static_cast<float>(angle)},
                 color);
        break;
      case 3: {
        std::vector<cv::Point> corners;
        for (int k = 0; k < 3; ++k) {
          const int x = at.x + rng.integer(-radius, radius);
          corners.emplace_back(x, at.y + rng.integer(-radius, radius));
        }
        cv::fillConvexPoly(image, corners, color, cv::LINE_AA);
        break;
      }
      default: {
        const cv::Point to(at.x + cvRound(scale * std::cos(angle)),
                           at.y + cvRound(scale * std::sin(angle)));
        cv::line(image, at, to, color, std::max(1, radius / 8), cv::LINE_AA);
        break;
      }
    }
  }
  add_grain(image, larger / 6, 14, rng);
  return image;
}

cv::Mat clutter_image(int size, std::uint64_t seed) {
  TARSIER_REQUIRE(size >= 64 && size <= 4096, "{} px", size);
  Rng rng(seed ^ 0xc1077e4ULL);
  cv::Mat image(size, size, CV_8UC3);
  draw_surface(image, rng);
  const int objects = rng.integer(25, 90);
  for (int i = 0; i < objects; ++i) draw_object(image, rng);
  add_grain(image, size / 40.0, 5, rng);
  return image;
}

PlanarPrint occluder_print(bool is_hand, double width, std::uint64_t seed) {
  Rng rng(seed ^ 0xc07e4ULL);
  constexpr int kSize = 256;
  cv::Mat color(kSize, kSize, CV_8UC3);
  cv::Mat alpha = cv::Mat::zeros(kSize, kSize, CV_8UC1);
  if (is_hand) {
    const double shade = rng.uniform(0.5, 1.0);
    color.setTo(cv::Scalar(130 * shade, 165 * shade, 215 * shade));
    cv::ellipse(alpha, {128, 160}, {62, 66}, 0, 0, 360, 255, cv::FILLED, cv::LINE_AA);
    cv::line(alpha, {128, 180}, {128, 300}, 255, 86, cv::LINE_AA);
    const std::array<std::pair<cv::Point, cv::Point>, 5> fingers{{{{78, 130}, {48, 50}},
                                                                  {{108, 110}, {98, 22}},
                                                                  {{140, 110}, {146, 20}},
                                                                  {{170, 124}, {192, 44}},
                                                                  {{80, 180}, {18, 130}}}};
    for (const auto& [from, to] : fingers) {
      cv::line(alpha, from, to, 255, 27, cv::LINE_AA);
      cv::line(color, from, to, cv::Scalar(120 * shade, 150 * shade, 200 * shade), 20, cv::LINE_AA);
    }
    add_grain(color, 40, 8, rng);
  } else {
    color.setTo(random_paint(rng, 20, 200));
    cv::rectangle(alpha, cv::Rect(96, 0, 64, kSize), 255, cv::FILLED);
    add_grain(color, 40, 8, rng);
  }
  PlanarPrint print;
  print.id = -1;
  print.name = is_hand ? "hand" : "bar";
  cv::merge(std::vector<cv::Mat>{color, alpha}, print.image);  // three channels and one
  print.width = width;
  return print;
}

}  // namespace tarsier::synth
