// SPDX-License-Identifier: MIT
#include "tarsier/face/appearance/model.h"

#include "tarsier/core/require.h"
#include "tarsier/face/appearance/frame_sampler.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tarsier::face::appearance {

using Eigen::Index;
using Eigen::Matrix2Xd;
using Eigen::MatrixXf;
using Eigen::VectorXf;

void AppearanceOptions::check() const {
  check_fields(*this);
  shape.check();
  TARSIER_REQUIRE((frame_width >> (levels - 1)) >= 8, "{} levels of a frame {} px wide", levels,
                  frame_width);
  TARSIER_REQUIRE(mesh.empty() || margin == 0, "a given mesh goes without a margin");
}

MatrixXf Texture::modes() const {
  MatrixXf basis = packed_modes.cast<float>() * steps.asDiagonal();
  const Index n = basis.rows();
  // Modified Gram-Schmidt, twice, because of single precision.
  const VectorXf along = mean.normalized();
  for (Index k = 0; k < basis.cols(); ++k) {
    auto column = basis.col(k);
    for (int pass = 0; pass < 2; ++pass) {
      if (has_offset(channels)) column.array() -= column.sum() / static_cast<float>(n);
      column -= column.dot(along) * along;
      for (Index j = 0; j < k; ++j) column -= column.dot(basis.col(j)) * basis.col(j);
      const float length = column.norm();
      if (length > 1e-12F) column /= length;
    }
  }
  return basis;
}

Matrix2Xd AppearanceModel::extended(const Matrix2Xd& points) const {
  TARSIER_REQUIRE(points.cols() == shape.mean.cols(), "{} points for a model of {}", points.cols(),
                  shape.mean.cols());
  Matrix2Xd all(2, points.cols() + static_cast<Index>(outer.size()));
  all.leftCols(points.cols()) = points;
  const Eigen::Vector2d center = points.rowwise().mean();
  Index at = points.cols();
  for (const int i : outer) {
    all.col(at++) = points.col(i) + margin * (points.col(i) - center);
  }
  return all;
}

Texture empty_texture(const AppearanceModel& model, Channels channels, double px_per_unit) {
  const Matrix2Xd scaled = px_per_unit * model.extended(model.shape.mean);
  const Eigen::Vector2d low = scaled.rowwise().minCoeff();
  const Eigen::Vector2d high = scaled.rowwise().maxCoeff();
  const Eigen::Vector2d origin = -low;
  const cv::Size size(static_cast<int>(std::floor(high.x() - low.x())) + 1,
                      static_cast<int>(std::floor(high.y() - low.y())) + 1);
  Texture texture(shape::PiecewiseWarp(scaled.colwise() + origin, model.mesh, size), channels);
  texture.px_per_unit = px_per_unit;
  texture.origin = origin;
  return texture;
}

CropFrame crop_frame(const Texture& texture) {
  const cv::Size frame = texture.warp.size();
  const int around = static_cast<int>(std::ceil(0.35 * std::max(frame.width, frame.height))) + 4;
  return {{texture.px_per_unit, 0, texture.origin.x() + around, texture.origin.y() + around},
          {frame.width + 2 * around, frame.height + 2 * around}};
}

TextureFit fit_texture(const AppearanceModel& model, const Texture& texture, const MatrixXf& modes,
                       const cv::Mat& image, const Matrix2Xd& points) {
  TARSIER_REQUIRE(points.allFinite(), "a point is not finite");
  TARSIER_REQUIRE(modes.rows() == texture.size() && modes.cols() == texture.mode_count(),
                  "modes of another texture");
  const CropFrame crop = crop_frame(texture);
  const shape::Similarity2d image_from_model = shape::fit_similarity(model.shape.mean, points);
  const shape::Similarity2d image_from_crop = image_from_model * crop.crop_from_model.inverse();
  UprightCrop upright;
  make_upright_crop(image, image_from_crop, crop.size, texture.channels, upright);
  const FrameSampler sampler(texture.warp);
  std::vector<FrameSampler::Affine> maps;
  sampler.maps(model.extended(image_from_crop.inverse()(points)), maps);

  TextureFit result;
  result.sampled.resize(texture.size());
  sampler.sample(upright.values, maps, result.sampled.data());
  if (!upright.inside.empty()) {
    std::vector<std::uint8_t> inside;
    result.inside =
        sampler.look_up(upright.inside, maps, inside) / static_cast<double>(sampler.pixels());
  }
  const auto n = static_cast<double>(texture.size());
  if (has_offset(texture.channels)) result.offset = static_cast<double>(result.sampled.sum()) / n;
  const VectorXf g = result.sampled.array() - static_cast<float>(result.offset);
  result.gain = static_cast<double>(g.dot(texture.mean)) / n;
  const VectorXf c = modes.transpose() * g;
  const auto square = static_cast<double>(g.squaredNorm());
  const double left = square - n * result.gain * result.gain - static_cast<double>(c.squaredNorm());
  result.error = square > 0 ? std::sqrt(std::max(0.0, left) / square) : 1;
  result.c = c.cast<double>() / (result.gain != 0 ? result.gain : 1);
  return result;
}

void AppearanceModel::check() const {
  shape.check();
  const int n = shape.points();
  const int all = n + static_cast<int>(outer.size());
  TARSIER_REQUIRE(n >= 3, "{} points", n);
  TARSIER_REQUIRE(margin >= 0 && margin <= 1 && outer.size() <= static_cast<std::size_t>(n),
                  "margin {} of {} points", margin, outer.size());
  for (const int i : outer) TARSIER_REQUIRE(i >= 0 && i < n, "outer point {} of {}", i, n);
  TARSIER_REQUIRE(!mesh.empty() && mesh.size() <= 10U * static_cast<unsigned>(all),
                  "{} triangles of {} points", mesh.size(), all);
  std::vector<bool> is_used(static_cast<std::size_t>(all), false);
  for (const shape::Triangle& triangle : mesh) {
    for (const int i : triangle) {
      TARSIER_REQUIRE(i >= 0 && i < all, "a triangle with point {} of {}", i, all);
      is_used[static_cast<std::size_t>(i)] = true;
    }
  }
  for (int i = 0; i < all; ++i)
    TARSIER_REQUIRE(is_used[static_cast<std::size_t>(i)], "point {} is in no triangle", i);
  TARSIER_REQUIRE(!levels.empty() && levels.size() <= 5, "{} levels", levels.size());
  const auto check_texture = [&](const Texture& texture) {
    const auto size =
        static_cast<Index>(texture.warp.pixels().size()) * channel_count(texture.channels);
    TARSIER_REQUIRE(size > 0, "a frame without pixels");
    TARSIER_REQUIRE(texture.warp.frame_points().cols() == all, "a frame of {} points, not {}",
                    texture.warp.frame_points().cols(), all);
    TARSIER_REQUIRE(texture.mean.size() == size && texture.packed_modes.rows() == size,
                    "a texture of {} numbers, its frame has {}", texture.mean.size(), size);
    TARSIER_REQUIRE(texture.packed_modes.cols() == texture.deviation.size() &&
                        texture.steps.size() == texture.deviation.size(),
                    "{} modes, {} deviations", texture.packed_modes.cols(),
                    texture.deviation.size());
    TARSIER_REQUIRE(
        texture.mean.allFinite() && texture.steps.allFinite() && texture.deviation.allFinite(),
        "a texture that is not finite");
    TARSIER_REQUIRE(texture.deviation.size() == 0 || texture.deviation.minCoeff() >= 0,
                    "a negative deviation");
    const double rms =
        static_cast<double>(texture.mean.norm()) / std::sqrt(static_cast<double>(size));
    TARSIER_REQUIRE(rms > 0.9 && rms < 1.1, "a mean texture of RMS {}", rms);
  };
  for (const Texture& level : levels) check_texture(level);
  for (std::size_t k = 1; k < levels.size(); ++k)
    TARSIER_REQUIRE(levels[k].px_per_unit <= levels[k - 1].px_per_unit, "levels out of order");
  if (colour) {
    TARSIER_REQUIRE(colour->channels == Channels::kColour, "a colour texture of {} channels",
                    channel_count(colour->channels));
    check_texture(*colour);
  }
  TARSIER_REQUIRE(lost_error >= 0 && std::isfinite(lost_error), "lost error {}", lost_error);
}

}  // namespace tarsier::face::appearance
