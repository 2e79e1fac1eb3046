// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/show.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/media/image_file.h"

#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>

namespace tarsier::face::shape {
namespace {

using Eigen::Matrix2Xd;

const cv::Scalar kLineColor(230, 230, 210);
const cv::Scalar kPointColor(60, 200, 255);
const cv::Scalar kHiddenColor(70, 110, 250);
const cv::Scalar kLeftColor(90, 220, 90);
const cv::Scalar kRightColor(70, 110, 255);
const cv::Scalar kBackground(92, 76, 62);  // grey-blue
const cv::Scalar kFaintColor(134, 118, 104);
const cv::Scalar kDarkColor(40, 34, 28);
constexpr int kFractionBits = 4;
constexpr double kMaxSigma = 3;
constexpr int kGap = 2;  // px between cells

bool is_drawable(const Matrix2Xd& points, int i) {
  return i >= 0 && i < points.cols() && std::abs(points(0, i)) < 1e5 &&
         std::abs(points(1, i)) < 1e5;  // false for NaN
}

cv::Point fixed(const Matrix2Xd& points, int i) {
  constexpr double kSteps = 1 << kFractionBits;
  return {static_cast<int>(std::lround(points(0, i) * kSteps)),
          static_cast<int>(std::lround(points(1, i) * kSteps))};
}

void draw_lines(cv::Mat& image, const Matrix2Xd& points,
                const std::vector<std::array<int, 2>>& connections, const cv::Scalar& color,
                int thickness) {
  for (const auto& [a, b] : connections) {
    if (!is_drawable(points, a) || !is_drawable(points, b)) continue;
    cv::line(image, fixed(points, a), fixed(points, b), color, thickness, cv::LINE_AA,
             kFractionBits);
  }
}

// -1: image left, 1: image right, 0: on the axis or unknown. The pairs vote for the direction from
// left to right, so that a head lying on its side keeps its colours.
std::vector<int> sides_of(const Matrix2Xd& points, const std::vector<int>& mirror) {
  std::vector<int> sides(static_cast<std::size_t>(points.cols()), 0);
  if (mirror.size() != sides.size()) return sides;
  const auto across = [&](int i) -> Eigen::Vector2d {
    const int other = mirror[static_cast<std::size_t>(i)];
    if (other == i || !is_drawable(points, i) || !is_drawable(points, other)) return {0, 0};
    return points.col(other) - points.col(i);
  };
  Eigen::Vector2d direction(0, 0);
  for (int i = 0; i < static_cast<int>(points.cols()); ++i) {
    const Eigen::Vector2d step = across(i);
    direction += step.dot(direction) < 0 ? Eigen::Vector2d(-step) : step;
  }
  if (direction.x() < 0) direction = -direction;
  for (int i = 0; i < static_cast<int>(points.cols()); ++i) {
    const double along = across(i).dot(direction);
    sides[static_cast<std::size_t>(i)] = along > 0 ? -1 : along < 0 ? 1 : 0;
  }
  return sides;
}

// The content of a cell: a square crop around the points (or the box, or the whole image).
struct Crop {
  double x = 0;  // of its left upper pixel's centre
  double y = 0;
  double side = 1;
};

Crop crop_around(const LandmarkSample& sample, cv::Size image) {
  constexpr double kMargin = 0.25;  // of the larger side, on each side
  double left = 1e9;
  double top = 1e9;
  double right = -1e9;
  double bottom = -1e9;
  for (int i = 0; i < static_cast<int>(sample.points.cols()); ++i) {
    if (!is_drawable(sample.points, i)) continue;
    left = std::min(left, sample.points(0, i));
    right = std::max(right, sample.points(0, i));
    top = std::min(top, sample.points(1, i));
    bottom = std::max(bottom, sample.points(1, i));
  }
  double margin = kMargin;
  if (left > right) {
    const cv::Rect2d box = sample.box.value_or(cv::Rect2d(0, 0, image.width, image.height));
    left = box.x;
    top = box.y;
    right = box.x + box.width - 1;
    bottom = box.y + box.height - 1;
    margin = sample.box ? kMargin : 0;
  }
  const double side =
      std::clamp(std::max(right - left, bottom - top) * (1 + 2 * margin), 8.0, 20000.0);
  return {(left + right - side) / 2, (top + bottom - side) / 2, side};
}

// Draws `crop` of the image in cell_px x cell_px; dark outside the image.
cv::Mat cell_of(const cv::Mat& image, const Crop& crop, int cell_px) {
  const double scale = cell_px / crop.side;
  // Reduce by areas first: the affine warp alone would alias.
  cv::Mat source = image;
  double reduction = 1;
  if (scale < 0.75) {
    reduction = scale;
    const cv::Size size(std::max(1, static_cast<int>(std::lround(image.cols * scale))),
                        std::max(1, static_cast<int>(std::lround(image.rows * scale))));
    cv::resize(image, source, size, 0, 0, cv::INTER_AREA);
  }
  const double sx = static_cast<double>(source.cols) / image.cols;
  const double sy = static_cast<double>(source.rows) / image.rows;
  // Cell from source, pixel centres at integers.
  const cv::Matx23d warp(scale / sx, 0, (0.5 / sx - 0.5 - crop.x) * scale + (scale - 1) / 2, 0,
                         scale / sy, (0.5 / sy - 0.5 - crop.y) * scale + (scale - 1) / 2);
  cv::Mat cell;
  cv::warpAffine(source, cell, warp, cv::Size(cell_px, cell_px),
                 reduction < 1 ? cv::INTER_LINEAR : cv::INTER_CUBIC, cv::BORDER_CONSTANT,
                 kDarkColor);
  return cell;
}

std::string wrapped(const std::string& text, std::size_t width) {
  std::string result;
  for (std::size_t at = 0; at < text.size() && at < 6 * width; at += width) {
    if (at > 0) result += '\n';
    result.append(text, at, width);
  }
  return result;
}

void draw_sample(cv::Mat& cell, const LandmarkSet& set, const LandmarkSample& sample,
                 const std::string& set_path, const LandmarkStyle& style) {
  const int cell_px = cell.cols;
  image::draw::TextStyle text;
  text.height_px = std::clamp(cell_px / 24.0, 5.0, 14.0);
  const auto letters = static_cast<std::size_t>(std::max(
      6.0, (cell_px - 6) /
               std::max(1.0, image::draw::text_size("nnnnnnnnnn", text.height_px).width / 10.0)));
  std::string name = std::filesystem::path(sample.image).filename().string();
  if (name.size() > letters) name = name.substr(name.size() - letters);
  try {
    const cv::Mat image = read_image(image_path(set_path, sample));
    const Crop crop = crop_around(sample, image.size());
    cell_of(image, crop, cell_px).copyTo(cell);
    const double scale = cell_px / crop.side;
    Matrix2Xd points(2, sample.points.cols());
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      points(0, i) = (sample.points(0, i) - crop.x + 0.5) * scale - 0.5;
      points(1, i) = (sample.points(1, i) - crop.y + 0.5) * scale - 0.5;
    }
    draw_landmarks(cell, points, set.connections, set.mirror, style);
  } catch (const Error& error) {
    cell.setTo(kDarkColor);
    std::string reason = error.what();
    if (const std::size_t colon = reason.rfind(": "); colon != std::string::npos)
      reason.erase(0, colon + 2);
    text.backing = image::draw::Backing::kNone;
    text.color = {150, 170, 255};
    image::draw::put_text(cell, wrapped(reason, letters), {cell_px / 2, cell_px / 2}, text,
                          image::draw::Anchor::kCenter);
    text.backing = image::draw::Backing::kOutline;
    text.color = {255, 255, 255};
  }
  image::draw::put_text(cell, name, {2, cell_px - 2}, text, image::draw::Anchor::kBottomLeft);
}

// Half the width and height in the model's frame that all modes need at +-3 sigma.
Eigen::Vector2d half_extent_of(const ShapeModel& model) {
  Eigen::Vector2d half_extent = model.mean.cwiseAbs().rowwise().maxCoeff();
  Eigen::VectorXd b = Eigen::VectorXd::Zero(model.mode_count());
  for (int k = 0; k < model.mode_count(); ++k) {
    for (const double sigma : {-kMaxSigma, kMaxSigma}) {
      b[k] = sigma * model.deviation[k];
      half_extent = half_extent.cwiseMax(shape_of(model, b).cwiseAbs().rowwise().maxCoeff());
    }
    b[k] = 0;
  }
  return half_extent;
}

struct ShapeView {
  const ShapeModel& model;
  Eigen::Vector2d half_extent;
};

void draw_shape_in(cv::Mat& image, const cv::Rect& area, const ShapeView& view,
                   const Eigen::VectorXd& b) {
  constexpr double kFillShare = 0.92;
  const double scale =
      kFillShare / 2 *
      std::min(area.width / view.half_extent.x(), area.height / view.half_extent.y());
  const Similarity2d image_from_model{scale, 0, area.x + (area.width - 1) / 2.0,
                                      area.y + (area.height - 1) / 2.0};
  const double unit = std::min(area.width, area.height);
  const int thickness = std::clamp(static_cast<int>(std::lround(unit / 260)), 1, 4);
  const double radius = std::clamp(unit / 130, 1.2, 6.0);
  const Matrix2Xd mean = image_from_model(view.model.mean);
  const Matrix2Xd shape = image_from_model(shape_of(view.model, b));
  draw_lines(image, mean, view.model.connections, kFaintColor, thickness);
  if (view.model.connections.empty()) {
    for (int i = 0; i < view.model.points(); ++i)
      image::draw::point(image, {mean(0, i), mean(1, i)}, kFaintColor, radius);
  }
  draw_lines(image, shape, view.model.connections, kLineColor, thickness);
  for (int i = 0; i < view.model.points(); ++i) {
    if (is_drawable(shape, i))
      image::draw::point(image, {shape(0, i), shape(1, i)}, kPointColor, radius);
  }
}

// A bar from -3 to 3 sigma, filled from its middle.
void draw_value(cv::Mat& image, const cv::Rect& box, double sigmas) {
  image::draw::fill_rounded(image, box, box.height / 2, kDarkColor);
  const double half = box.width / 2.0;
  const double share = std::clamp(sigmas / kMaxSigma, -1.0, 1.0);
  const int center = box.x + box.width / 2;
  const int end = static_cast<int>(std::lround(box.x + half + share * half));
  const cv::Rect filled(std::min(center, end), box.y, std::max(1, std::abs(end - center)),
                        box.height);
  image::draw::fill_rounded(image, filled, 0, kPointColor);
  cv::line(image, {center, box.y - 2}, {center, box.y + box.height + 1}, kLineColor, 1);
}

std::string signed_text(double sigmas) {
  return fmt::format("{:+.1f} sd", std::abs(sigmas) < 0.05 ? 0.0 : sigmas);
}

// A mode's share of the whole variance.
double share_of(const ShapeModel& model, int mode) {
  const double kept = model.deviation.squaredNorm();
  return kept > 0 ? model.deviation[mode] * model.deviation[mode] / kept * model.variance_kept : 0;
}

cv::Mat drawn_shape(const ShapeView& view, const Eigen::VectorXd& b, cv::Size size,
                    const std::string& title, double sigmas) {
  cv::Mat image(size, CV_8UC3, kBackground);
  image::draw::TextStyle text;
  text.height_px = std::clamp(image::draw::fitting_text_height(size) * 0.75, 5.0, 30.0);
  text.backing = image::draw::Backing::kNone;
  const int pad = std::max(2, static_cast<int>(text.height_px / 2));
  const cv::Rect head = image::draw::put_text(image, title, {pad, pad}, text);
  const int bar_height = std::max(3, static_cast<int>(text.height_px * 0.8));
  const int label_width = image::draw::text_size("+0.0 sd", text.height_px).width;
  const cv::Rect bar(pad, size.height - 2 * pad - bar_height,
                     std::max(8, size.width - 3 * pad - label_width), bar_height);
  const int top = head.y + head.height;
  const cv::Rect area(0, top, size.width, std::max(8, bar.y - pad - top));
  draw_shape_in(image, area, view, b);
  if (view.model.mode_count() > 0) {
    draw_value(image, bar, sigmas);
    image::draw::put_text(image, signed_text(sigmas),
                          {bar.x + bar.width + pad, bar.y + bar.height / 2}, text,
                          image::draw::Anchor::kLeft);
  }
  return image;
}

void require_size(cv::Size size) {
  TARSIER_REQUIRE(
      size.width >= 32 && size.height >= 32 && size.width <= 8000 && size.height <= 8000,
      "an image of {} x {}", size.width, size.height);
}

}  // namespace

void draw_landmarks(cv::Mat& image, const Matrix2Xd& points,
                    const std::vector<std::array<int, 2>>& connections,
                    const std::vector<int>& mirror, const LandmarkStyle& style) {
  TARSIER_REQUIRE(image.type() == CV_8UC3 && !image.empty(), "an image that is not BGR");
  TARSIER_REQUIRE(std::isfinite(style.radius_px) && style.radius_px >= 0, "radius {}",
                  style.radius_px);
  const double side = std::min(image.cols, image.rows);
  const double radius = style.radius_px > 0 ? style.radius_px : std::clamp(side / 150, 1.2, 8.0);
  const int thickness = std::clamp(static_cast<int>(std::lround(radius / 2)), 1, 4);
  if (style.connections) {
    // A dark line below: a light one alone is hardly visible on skin.
    draw_lines(image, points, connections, kDarkColor, thickness + 1);
    draw_lines(image, points, connections, kLineColor, thickness);
  }
  TARSIER_REQUIRE(style.sigma_px.size() == 0 || style.sigma_px.size() == points.cols(),
                  "{} deviations of {} points", style.sigma_px.size(), points.cols());
  const auto sigma_of = [&](int i) {
    const double sigma = style.sigma_px.size() > 0 ? style.sigma_px(i) : 0.0;
    return std::isfinite(sigma) ? std::clamp(sigma, 0.0, side) : 0.0;
  };
  const std::vector<int> sides = sides_of(points, mirror);
  image::draw::TextStyle text;
  text.height_px = std::clamp(2 * radius, 5.0, 40.0);
  for (int i = 0; i < static_cast<int>(points.cols()); ++i) {
    if (!is_drawable(points, i)) continue;
    if (static_cast<std::size_t>(i) < style.hidden.size() &&
        style.hidden[static_cast<std::size_t>(i)]) {
      const int ring = cvRound(std::max(1.3 * radius, sigma_of(i)) * (1 << kFractionBits));
      cv::circle(image, fixed(points, i), ring, kDarkColor, thickness + 1, cv::LINE_AA,
                 kFractionBits);
      cv::circle(image, fixed(points, i), ring, kHiddenColor, thickness, cv::LINE_AA,
                 kFractionBits);
      continue;
    }
    if (style.all_sigmas && sigma_of(i) > radius) {
      cv::circle(image, fixed(points, i), cvRound(sigma_of(i) * (1 << kFractionBits)), kPointColor,
                 1, cv::LINE_AA, kFractionBits);
    }
    const int image_side = style.symmetry ? sides[static_cast<std::size_t>(i)] : 0;
    image::draw::point(image, {points(0, i), points(1, i)},
                       image_side < 0 ? kLeftColor : (image_side > 0 ? kRightColor : kPointColor),
                       radius);
  }
  for (int i = 0; style.numbers && i < static_cast<int>(points.cols()); ++i) {
    if (!is_drawable(points, i)) continue;
    image::draw::put_text(image, fmt::format("{}", i),
                          {static_cast<int>(std::lround(points(0, i) + radius)),
                           static_cast<int>(std::lround(points(1, i)))},
                          text, image::draw::Anchor::kLeft);
  }
}

cv::Mat contact_sheet(const LandmarkSet& set, const std::string& set_path, int cell_px, int columns,
                      int max_samples, const LandmarkStyle& style) {
  set.check();
  TARSIER_REQUIRE(cell_px >= 32 && cell_px <= 2000, "cells of {} px", cell_px);
  TARSIER_REQUIRE(max_samples >= 1, "at most {} samples", max_samples);
  TARSIER_REQUIRE(!set.samples.empty(), "a set without samples");
  const int count = static_cast<int>(
      std::min<std::size_t>(set.samples.size(), static_cast<std::size_t>(max_samples)));
  const int wide = std::min(
      count, columns > 0 ? columns : static_cast<int>(std::ceil(std::sqrt(count * 4.0 / 3))));
  const int high = (count + wide - 1) / wide;
  const int step = cell_px + kGap;
  TARSIER_REQUIRE(static_cast<double>(step) * step * wide * high <= 1e8,
                  "a sheet of {} cells of {} px", count, cell_px);
  cv::Mat sheet(high * step - kGap, wide * step - kGap, CV_8UC3, kDarkColor);
  cv::parallel_for_(cv::Range(0, count), [&](const cv::Range& range) {
    for (int k = range.start; k < range.end; ++k) {
      cv::Mat cell = sheet(cv::Rect((k % wide) * step, (k / wide) * step, cell_px, cell_px));
      draw_sample(cell, set, set.samples[static_cast<std::size_t>(k)], set_path, style);
    }
  });
  return sheet;
}

cv::Mat draw_shape(const ShapeModel& model, const Eigen::VectorXd& b, cv::Size size,
                   const std::string& title) {
  require_size(size);
  TARSIER_REQUIRE(b.size() == model.mode_count() && b.allFinite(), "{} parameters of {} modes",
                  b.size(), model.mode_count());
  // The bar shows the mode with the largest value.
  double sigmas = 0;
  for (Eigen::Index k = 0; k < b.size(); ++k) {
    const double value = model.deviation[k] > 0 ? b[k] / model.deviation[k] : 0;
    if (std::abs(value) > std::abs(sigmas)) sigmas = value;
  }
  return drawn_shape({model, half_extent_of(model)}, b, size, title, sigmas);
}

cv::Mat draw_modes(const ShapeModel& model, int modes, int cell_px) {
  TARSIER_REQUIRE(modes >= 1 && cell_px >= 32 && cell_px <= 2000, "{} modes, cells of {} px", modes,
                  cell_px);
  constexpr std::array<double, 5> kValues{-3, -1.5, 0, 1.5, 3};
  const int rows = std::max(1, std::min(modes, model.mode_count()));
  image::draw::TextStyle text;
  text.height_px = std::clamp(cell_px / 18.0, 6.0, 30.0);
  text.backing = image::draw::Backing::kNone;
  const int left = image::draw::text_size("mode 00", text.height_px).width + 8;
  const int top = image::draw::text_size("+0.0 sd", text.height_px).height + 4;
  const int step = cell_px + kGap;
  TARSIER_REQUIRE(static_cast<double>(step) * rows * step * 5 <= 1e8, "{} rows of {} px", rows,
                  cell_px);
  cv::Mat image(top + rows * step, left + static_cast<int>(kValues.size()) * step, CV_8UC3,
                kDarkColor);
  const ShapeView view{model, half_extent_of(model)};
  for (int column = 0; column < static_cast<int>(kValues.size()); ++column) {
    const double value = kValues[static_cast<std::size_t>(column)];
    const int x = left + column * step;
    image::draw::put_text(image, signed_text(value), {x + cell_px / 2, top / 2}, text,
                          image::draw::Anchor::kCenter);
    for (int row = 0; row < rows; ++row) {
      const cv::Rect cell(x, top + row * step, cell_px, cell_px);
      image(cell).setTo(kBackground);
      Eigen::VectorXd b = Eigen::VectorXd::Zero(model.mode_count());
      if (row < model.mode_count()) b[row] = value * model.deviation[row];
      cv::Mat part = image(cell);
      draw_shape_in(part, cv::Rect(0, 0, cell_px, cell_px), view, b);
    }
  }
  for (int row = 0; row < rows; ++row) {
    const std::string label = row < model.mode_count() ? fmt::format("mode {}\n{:.1f} %", row + 1,
                                                                     100 * share_of(model, row))
                                                       : std::string("mean");
    image::draw::put_text(image, label, {left / 2, top + row * step + cell_px / 2}, text,
                          image::draw::Anchor::kCenter);
  }
  return image;
}

std::vector<cv::Mat> animate_modes(const ShapeModel& model, int modes, cv::Size size,
                                   int frames_per_mode) {
  require_size(size);
  TARSIER_REQUIRE(modes >= 1 && frames_per_mode >= 4 && frames_per_mode <= 10000,
                  "{} modes, {} frames for each", modes, frames_per_mode);
  const ShapeView view{model, half_extent_of(model)};
  const int count = std::min(modes, model.mode_count());
  std::vector<cv::Mat> frames;
  for (int mode = 0; mode < count; ++mode) {
    for (int k = 0; k < frames_per_mode; ++k) {
      const double sigmas = kMaxSigma * std::sin(2 * std::numbers::pi * k / frames_per_mode);
      Eigen::VectorXd b = Eigen::VectorXd::Zero(model.mode_count());
      b[mode] = sigmas * model.deviation[mode];
      frames.push_back(drawn_shape(view, b, size,
                                   fmt::format("mode {} of {}: {:.1f} % of the variance", mode + 1,
                                               model.mode_count(), 100 * share_of(model, mode)),
                                   sigmas));
    }
  }
  return frames;
}

}  // namespace tarsier::face::shape
