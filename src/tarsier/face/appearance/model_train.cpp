// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/appearance/frame_sampler.h"
#include "tarsier/face/appearance/model.h"
#include "tarsier/linalg/decompositions.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace tarsier::face::appearance {
namespace {

// The Delaunay triangles of points of size 1 without slivers along a nearly straight hull. These
// contain no pixels and fold easily.
std::vector<shape::Triangle> mesh_without_slivers(const Eigen::Matrix2Xd& points) {
  constexpr double kMinHeight = 0.02;
  std::vector<shape::Triangle> mesh = shape::delaunay(points);
  std::erase_if(mesh, [&](const shape::Triangle& triangle) {
    const Eigen::Vector2d a = points.col(triangle[1]) - points.col(triangle[0]);
    const Eigen::Vector2d b = points.col(triangle[2]) - points.col(triangle[0]);
    const double longest = std::max({a.norm(), b.norm(), (a - b).norm()});
    return std::abs(a.x() * b.y() - a.y() * b.x()) < kMinHeight * longest;
  });
  return mesh;
}

using Eigen::Index;
using Eigen::Matrix2Xd;
using Eigen::MatrixXd;
using Eigen::MatrixXf;
using Eigen::VectorXd;
using Eigen::VectorXf;

// A given mesh with positive area of each triangle.
std::vector<shape::Triangle> with_positive_areas(std::vector<shape::Triangle> mesh,
                                                 const Eigen::Matrix2Xd& points) {
  for (shape::Triangle& triangle : mesh) {
    for (const int corner : triangle)
      TARSIER_REQUIRE(corner >= 0 && corner < points.cols(), "a triangle of point {} of {}", corner,
                      points.cols());
    if (shape::count_folded({triangle}, points) > 0) std::swap(triangle[1], triangle[2]);
  }
  return mesh;
}

// The points on the outline of a triangulation: ends of the edges that belong to one triangle only.
std::vector<int> outline(const std::vector<shape::Triangle>& mesh) {
  std::map<std::pair<int, int>, int> edges;
  for (const auto& t : mesh) {
    for (std::size_t k = 0; k < 3; ++k) {
      const int a = t[k];
      const int b = t[(k + 1) % 3];
      ++edges[{std::min(a, b), std::max(a, b)}];
    }
  }
  std::vector<int> points;
  for (const auto& [edge, count] : edges) {
    if (count > 1) continue;
    points.push_back(edge.first);
    points.push_back(edge.second);
  }
  std::sort(points.begin(), points.end());
  points.erase(std::unique(points.begin(), points.end()), points.end());
  return points;
}

struct NormalisedTextures {
  MatrixXf textures;  // N x samples, normalised to the tangent at the mean
  VectorXf mean;
  double offset = 0;
  double gain = 0;
};

// Samples all textures as a fit does.
MatrixXf sample_all(const AppearanceModel& model, const Texture& texture,
                    const std::vector<TrainingImage>& images, const std::vector<int>& mirror,
                    const AppearanceOptions& options, Progress& progress,
                    const std::stop_token& stop) {
  const FrameSampler sampler(texture.warp);
  const CropFrame crop = crop_frame(texture);
  const Index n = Index{sampler.pixels()} * channel_count(texture.channels);
  const int each = options.mirror ? 2 : 1;
  MatrixXf textures(n, static_cast<Index>(images.size()) * each);
  progress.begin("textures", textures.cols(), "textures");
  cv::parallel_for_(cv::Range(0, static_cast<int>(images.size())), [&](const cv::Range& range) {
    UprightCrop upright;
    std::vector<FrameSampler::Affine> maps;
    for (int i = range.start; i < range.end; ++i) {
      if (stop.stop_requested()) return;
      for (int k = 0; k < each; ++k) {
        const TrainingImage& plain = images[static_cast<std::size_t>(i)];
        TrainingImage turned;
        if (k == 1) turned = mirrored(plain, mirror, options.to_the_right);
        const TrainingImage& image = k == 1 ? turned : plain;
        const shape::Similarity2d image_from_crop =
            shape::fit_similarity(model.shape.mean, image.points) * crop.crop_from_model.inverse();
        make_upright_crop(image.image, image_from_crop, crop.size, texture.channels, upright);
        sampler.maps(model.extended(image_from_crop.inverse()(image.points)), maps);
        sampler.sample(upright.values, maps, textures.col(i * each + k).data());
        progress.advance();
      }
    }
  });
  progress.end();
  throw_if_stopped(stop);
  return textures;
}

// Removes offset and gain. The mean is the fixed point: textures are scaled so that their
// projection on it equals it, and their mean is the new mean (Cootes and Taylor 2004, section 4.2).
NormalisedTextures normalise(MatrixXf textures, bool with_offset) {
  NormalisedTextures result;
  const auto n = static_cast<double>(textures.rows());
  VectorXd norms(textures.cols());
  for (Index i = 0; i < textures.cols(); ++i) {
    auto column = textures.col(i);
    if (with_offset) {
      const double offset = static_cast<double>(column.sum()) / n;
      column.array() -= static_cast<float>(offset);
      result.offset += offset;
    }
    norms[i] = std::sqrt(static_cast<double>(column.squaredNorm()) / n);
    if (norms[i] > 1e-6) column /= static_cast<float>(norms[i]);
  }
  VectorXf mean = textures.rowwise().mean();
  VectorXf factors = VectorXf::Ones(textures.cols());
  for (int round = 0; round < 5; ++round) {
    const double rms = std::sqrt(static_cast<double>(mean.squaredNorm()) / n);
    TARSIER_REQUIRE(rms > 1e-6, "the training images have no texture in common");
    mean /= static_cast<float>(rms);
    const VectorXf along = textures.transpose() * mean / static_cast<float>(n);
    // Limits the scale of images that have little in common with the others.
    factors = along.unaryExpr([](float a) { return 1 / std::max(a, 0.2F); });
    mean = textures * factors / static_cast<float>(textures.cols());
  }
  mean /= std::sqrt(static_cast<float>(static_cast<double>(mean.squaredNorm()) / n));
  textures = textures * factors.asDiagonal();
  result.gain = (norms.array() / factors.cast<double>().array()).mean();
  result.offset /= static_cast<double>(textures.cols());
  // Remove the remaining part along the mean.
  const VectorXf along = textures.transpose() * mean / static_cast<float>(n);
  textures.noalias() -= mean * along.transpose();
  result.textures = std::move(textures);  // residuals
  result.mean = std::move(mean);
  return result;
}

void train_texture(Texture& texture, NormalisedTextures sampled, double variance, int max_modes) {
  texture.mean = std::move(sampled.mean);
  texture.mean_offset = sampled.offset;
  texture.mean_gain = sampled.gain;
  const MatrixXf& residuals = sampled.textures;
  const Index n = residuals.rows();
  const Index count = residuals.cols();
  MatrixXf gram(count, count);
  gram.setZero();
  gram.selfadjointView<Eigen::Lower>().rankUpdate(residuals.transpose());
  const MatrixXd symmetric = MatrixXf(gram.selfadjointView<Eigen::Lower>()).cast<double>();
  const linalg::SymmetricEigen eigen = linalg::symmetric_eigen(symmetric);
  const VectorXd values = eigen.values.reverse().cwiseMax(0) / static_cast<double>(count);
  const double total = values.sum();
  Index modes = 0;
  double kept = 0;
  const auto max_count = std::min<Index>({Index{max_modes}, count - 1, n - 2});
  while (modes < max_count && kept < variance * total && values[modes] > 1e-6 * values[0]) {
    kept += values[modes++];
  }
  texture.deviation = values.head(modes).cwiseSqrt();
  texture.variance_kept = total > 0 ? kept / total : 1;
  texture.noise = std::sqrt(std::max(0.0, total - kept) / static_cast<double>(n));
  texture.packed_modes.resize(n, modes);
  texture.steps.resize(modes);
  for (Index k = 0; k < modes; ++k) {
    VectorXf mode = residuals * eigen.vectors.col(count - 1 - k).cast<float>();
    mode.normalize();
    Index largest_index = 0;
    const float largest = mode.cwiseAbs().maxCoeff(&largest_index);
    // A mode's sign is arbitrary.
    const float step = mode[largest_index] < 0 ? -largest / 127 : largest / 127;
    texture.packed_modes.col(k) =
        (mode / step).array().round().max(-127).min(127).cast<std::int8_t>();
    texture.steps[k] = std::abs(step);
  }
}

}  // namespace

AppearanceModel train_appearance_model(const std::vector<TrainingImage>& images,
                                       const std::vector<int>& mirror,
                                       const AppearanceOptions& options, Progress& progress,
                                       const std::stop_token& stop) {
  options.check();
  TARSIER_REQUIRE(images.size() >= 2, "{} images; two are needed", images.size());
  TARSIER_REQUIRE(
      !options.mirror || static_cast<Index>(mirror.size()) == images.front().points.cols(),
      "mirrored images need the symmetry of the points");
  AppearanceModel model;
  std::vector<Matrix2Xd> shapes;
  for (const TrainingImage& image : images) {
    TARSIER_REQUIRE(image.image.type() == CV_8UC3, "a training image of OpenCV's type {}",
                    image.image.type());
    TARSIER_REQUIRE(image.points.cols() == images.front().points.cols() && image.points.allFinite(),
                    "a training image of {} points; or one that is not finite",
                    image.points.cols());
    shapes.push_back(image.points);
    if (options.mirror) {
      shape::LandmarkSample sample;
      sample.points = image.points;
      shapes.push_back(shape::mirrored(sample, mirror, image.image.cols).points);
    }
  }
  model.shape = shape::train_shape_model(shapes, options.shape);
  if (!mirror.empty()) model.shape.mirror = mirror;
  model.margin = options.margin;
  model.mesh = options.mesh.empty() ? mesh_without_slivers(model.shape.mean)
                                    : with_positive_areas(options.mesh, model.shape.mean);
  if (options.margin > 0) {
    model.outer = outline(model.mesh);
    model.mesh = mesh_without_slivers(model.extended(model.shape.mean));
  }
  const Matrix2Xd all = model.extended(model.shape.mean);
  const double width = all.row(0).maxCoeff() - all.row(0).minCoeff();
  const auto train = [&](Channels channels, double frame_width, double variance, int modes) {
    Texture texture = empty_texture(model, channels, (frame_width - 1) / width);
    NormalisedTextures sampled = normalise(
        sample_all(model, texture, images, mirror, options, progress, stop), has_offset(channels));
    train_texture(texture, std::move(sampled), variance, modes);
    throw_if_stopped(stop);
    return texture;
  };
  for (int level = 0; level < options.levels; ++level) {
    model.levels.push_back(train(options.channels, options.frame_width / std::pow(2.0, level),
                                 options.texture_variance, options.texture_modes));
  }
  if (options.colour) {
    model.colour = train(Channels::kColour, options.colour_width, options.colour_variance,
                         options.colour_modes);
  }
  model.check();
  return model;
}

}  // namespace tarsier::face::appearance
