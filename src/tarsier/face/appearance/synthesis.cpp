// SPDX-License-Identifier: MIT
#include "tarsier/face/appearance/synthesis.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>

namespace tarsier::face::appearance {

using Eigen::Index;
using Eigen::Matrix2Xd;
using Eigen::VectorXd;
using Eigen::VectorXf;

namespace {

const cv::Scalar kBackground(58, 52, 48);
constexpr std::array<double, 5> kColumns{-3, -1.5, 0, 1.5, 3};

cv::Point fixed(const Eigen::Vector2d& point) {
  // 4 fractional bits. Coordinates far outside the image are limited.
  const Eigen::Vector2d at = point.cwiseMax(-1e5).cwiseMin(1e5) * 16;
  return {static_cast<int>(std::lround(at.x())), static_cast<int>(std::lround(at.y()))};
}

// A texture as an image; brightness is drawn unchanged.
cv::Mat to_frame(const Texture& texture, const VectorXf& values) {
  cv::Mat frame(texture.warp.size(), CV_8UC3, cv::Scalar(0, 0, 0));
  const int channels = channel_count(texture.channels);
  const auto& pixels = texture.warp.pixels();
  for (std::size_t k = 0; k < pixels.size(); ++k) {
    auto* to = frame.ptr<std::uint8_t>(pixels[k].y) + std::ptrdiff_t{3} * pixels[k].x;
    for (int c = 0; c < 3; ++c) {
      const auto at = static_cast<Index>(k) * channels + (channels == 3 ? c : 0);
      to[c] = static_cast<std::uint8_t>(std::clamp(values[at], 0.0F, 255.0F) + 0.5F);
    }
  }
  return frame;
}

// The norm of each pixel's channels, as brightness.
cv::Mat channel_norms(const Texture& texture, const VectorXf& values, double factor, double base) {
  cv::Mat frame(texture.warp.size(), CV_8UC3, cv::Scalar(0, 0, 0));
  const int channels = channel_count(texture.channels);
  const auto& pixels = texture.warp.pixels();
  for (std::size_t k = 0; k < pixels.size(); ++k) {
    const auto first = static_cast<Index>(k) * channels;
    const double value = channels == 1
                             ? static_cast<double>(values[first])
                             : static_cast<double>(values.segment(first, channels).norm());
    frame.at<cv::Vec3b>(pixels[k].y, pixels[k].x) =
        cv::Vec3b::all(cv::saturate_cast<std::uint8_t>(base + factor * value));
  }
  return frame;
}

}  // namespace

Synthesis::Synthesis(const AppearanceModel& model) : model_(&model) {
  if (model.colour)
    texture_ = &*model.colour;
  else if (!model.levels.empty() && has_offset(model.levels.front().channels))
    texture_ = &model.levels.front();
  TARSIER_REQUIRE(texture_ != nullptr, "a model without a colour texture cannot be drawn");
  modes_ = texture_->modes();
}

cv::Mat Synthesis::frame(const VectorXd& c, double offset, double gain) const {
  TARSIER_REQUIRE(c.size() <= modes_.cols(), "{} parameters of {} texture modes", c.size(),
                  modes_.cols());
  VectorXf values = texture_->mean;
  if (c.size() > 0) values.noalias() += modes_.leftCols(c.size()) * c.cast<float>();
  values = static_cast<float>(gain) * values.array() + static_cast<float>(offset);
  return to_frame(*texture_, values);
}

cv::Mat Synthesis::frame(const VectorXd& c) const {
  return frame(c, texture_->mean_offset, texture_->mean_gain);
}

void Synthesis::draw(const VectorXd& c, double offset, double gain, const Matrix2Xd& points,
                     cv::Mat& image) const {
  texture_->warp.from_frame(frame(c, offset, gain), model_->extended(points), image);
}

TextureFit Synthesis::fit_texture(const cv::Mat& image, const Matrix2Xd& points) const {
  return appearance::fit_texture(*model_, *texture_, modes_, image, points);
}

cv::Mat Synthesis::portrait(const VectorXd& b, const VectorXd& c, cv::Size size,
                            Matrix2Xd* points) const {
  const Matrix2Xd all = model_->extended(model_->shape.mean);
  const Eigen::Vector2d low = all.rowwise().minCoeff();
  const Eigen::Vector2d high = all.rowwise().maxCoeff();
  const double scale =
      0.84 * std::min(size.width / (high.x() - low.x()), size.height / (high.y() - low.y()));
  const Eigen::Vector2d center(0.5 * (size.width - 1), 0.5 * (size.height - 1));
  VectorXd whole = VectorXd::Zero(model_->shape.mode_count());
  whole.head(std::min(b.size(), whole.size())) = b.head(std::min(b.size(), whole.size()));
  const Matrix2Xd at = (scale * shape::shape_of(model_->shape, whole)).colwise() +
                       (center - scale * 0.5 * (low + high));
  cv::Mat image(size, CV_8UC3, kBackground);
  draw(c, texture_->mean_offset, texture_->mean_gain, at, image);
  if (points != nullptr) *points = at;
  return image;
}

RandomFace random_face(const AppearanceModel& model, const Texture& texture, std::uint64_t seed,
                       double spread) {
  Rng rng(seed);
  const auto draw = [&](const VectorXd& deviation) {
    VectorXd values(deviation.size());
    for (Index k = 0; k < values.size(); ++k)
      values[k] = spread * std::clamp(rng.normal(), -2.5, 2.5) * deviation[k];
    return values;
  };
  RandomFace face;
  face.b = draw(model.shape.deviation);
  face.c = draw(texture.deviation);
  return face;
}

cv::Mat draw_mode_grid(const AppearanceModel& model, int modes, int cell_px, std::uint64_t seed) {
  TARSIER_REQUIRE(modes >= 1 && modes <= 50, "{} modes", modes);
  TARSIER_REQUIRE(cell_px >= 40 && cell_px <= 1000, "cells of {} px", cell_px);
  const Synthesis synthesis(model);
  const int shapes = std::min(modes, model.shape.mode_count());
  const int textures = std::min(modes, synthesis.texture().mode_count());
  const int rows = shapes + textures + 1;
  const int label = std::max(70, cell_px / 2);
  const int head = std::max(20, cell_px / 6);
  const auto columns = static_cast<int>(kColumns.size());
  cv::Mat grid(head + rows * cell_px, label + columns * cell_px, CV_8UC3, kBackground);
  image::draw::TextStyle style;
  style.height_px = std::clamp(cell_px / 12.0, 7.0, 18.0);
  style.backing = image::draw::Backing::kNone;
  for (int c = 0; c < columns; ++c) {
    const double sigma = kColumns[static_cast<std::size_t>(c)];
    image::draw::put_text(
        grid, sigma == 0 ? std::string("mean") : fmt::format("{:+.1f} sigma", sigma),
        {label + c * cell_px + cell_px / 2, head / 2}, style, image::draw::Anchor::kCenter);
  }
  for (int r = 0; r < rows; ++r) {
    const bool is_shape = r < shapes;
    const bool is_random = r == rows - 1;
    const int k = is_shape ? r : r - shapes;
    image::draw::put_text(grid,
                          is_random ? std::string("random")
                                    : fmt::format("{} {}", is_shape ? "shape" : "look", k + 1),
                          {label / 2, head + r * cell_px + cell_px / 2}, style,
                          image::draw::Anchor::kCenter);
    for (int c = 0; c < columns; ++c) {
      VectorXd b;
      VectorXd t;
      if (is_random) {
        const RandomFace face =
            random_face(model, synthesis.texture(), seed + static_cast<std::uint64_t>(c), 0.7);
        b = face.b;
        t = face.c;
      } else {
        const double sigma = kColumns[static_cast<std::size_t>(c)];
        VectorXd& moved = is_shape ? b : t;
        const VectorXd& deviation =
            is_shape ? model.shape.deviation : synthesis.texture().deviation;
        moved = VectorXd::Zero(k + 1);
        moved[k] = sigma * deviation[k];
      }
      synthesis.portrait(b, t, {cell_px, cell_px})
          .copyTo(grid(cv::Rect(label + c * cell_px, head + r * cell_px, cell_px, cell_px)));
    }
  }
  return grid;
}

void draw_mesh(const AppearanceModel& model, const Matrix2Xd& points, cv::Mat& image,
               bool with_outer) {
  image::draw::require_canvas(image);
  const Matrix2Xd all = model.extended(points);
  const int shown = with_outer ? static_cast<int>(all.cols()) : model.points();
  const double size = (points.rowwise().maxCoeff() - points.rowwise().minCoeff()).maxCoeff();
  const int width = std::clamp(static_cast<int>(size / 250), 1, 20);
  for (const shape::Triangle& triangle : model.mesh) {
    for (std::size_t k = 0; k < 3; ++k) {
      const int a = triangle[k];
      const int b = triangle[(k + 1) % 3];
      if (a >= shown || b >= shown) continue;
      cv::line(image, fixed(all.col(a)), fixed(all.col(b)), {230, 200, 90}, width, cv::LINE_AA, 4);
    }
  }
  // Points would hide a small face.
  if (size < 80) return;
  const double radius = std::clamp(size / 110, 1.0, 20.0);
  for (Index i = 0; i < points.cols(); ++i)
    image::draw::point(image, {points(0, i), points(1, i)}, {80, 220, 255}, radius);
}

cv::Mat draw_error(const AppearanceModel& model, const cv::Mat& image, const Matrix2Xd& points) {
  const Texture& texture = model.levels.front();
  const Eigen::MatrixXf modes = texture.modes();
  const TextureFit fit = fit_texture(model, texture, modes, image, points);
  VectorXf made = texture.mean;
  made.noalias() += modes * fit.c.cast<float>();
  made = static_cast<float>(fit.gain) * made.array() + static_cast<float>(fit.offset);
  const VectorXf difference = fit.sampled - made;
  cv::Mat parts[3];
  if (has_offset(texture.channels)) {
    parts[0] = to_frame(texture, fit.sampled);
    parts[1] = to_frame(texture, made);
    const VectorXf shown = difference.array() + 128.0F;
    parts[2] = to_frame(texture, shown);
  } else {
    const double factor =
        120 / std::max(1e-9, std::abs(fit.gain) * std::sqrt(channel_count(texture.channels)));
    parts[0] = channel_norms(texture, fit.sampled, factor, 0);
    parts[1] = channel_norms(texture, made, factor, 0);
    parts[2] = channel_norms(texture, difference, factor, 0);
  }
  cv::Mat row;
  cv::hconcat(parts, 3, row);
  return row;
}

}  // namespace tarsier::face::appearance
