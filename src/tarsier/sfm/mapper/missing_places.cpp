// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/missing_places.h"

#include "tarsier/core/at.h"
#include "tarsier/geometry/opencv_types.h"
#include "tarsier/sfm/mapper/absolute_pose.h"
#include "tarsier/sfm/mapper/contradicted_images.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <set>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr std::size_t kMinMatchedFeatures = 10;
constexpr std::size_t kMinFirstFeatures = 20;
constexpr std::size_t kMinSecondFeatures = 7;
constexpr double kMinSeparation = 0.97;
constexpr int kDirections = 36;        // that are tried for the line
constexpr double kMinMissing = 10;     // points that should be found
constexpr double kMinNearShare = 0.3;  // of the shared points of the image that shares most
constexpr int kMinSharedPoints = 3;

// A feature of the image and the point of the model that it matches.
struct PointMatch {
  int feature = 0;
  int point = 0;
  friend auto operator<=>(const PointMatch&, const PointMatch&) = default;
};

// A pose, and what fits it.
struct Fit {
  geometry::Rigid3 pose;
  std::vector<cv::Point2d> pixels;
  std::set<int> features;
  std::vector<int> points;
};

// One image, and the model with which it is compared.
class Comparison {
 public:
  Comparison(const Image& image, const Model& model, std::set<PointMatch> matches,
             const MapperOptions& options)
      : image_(image),
        model_(model),
        camera_(model.cameras[at(image.camera)]),
        matches_(std::move(matches)),
        options_(options) {}

  [[nodiscard]] bool is_relevant() const {
    std::set<int> features;
    for (const PointMatch& match : matches_) features.insert(match.feature);
    return features.size() >= kMinMatchedFeatures;
  }

  // Empty where the image does not show a missing place.
  [[nodiscard]] std::optional<MissingPlace> missing_place() {
    const std::optional<Fit> first = best_fit();
    if (!first || first->features.size() < kMinFirstFeatures) return std::nullopt;
    std::erase_if(matches_,
                  [&](const PointMatch& match) { return first->features.contains(match.feature); });
    const std::optional<Fit> second = best_fit();
    if (!second || second->features.size() < kMinSecondFeatures) return std::nullopt;
    const std::optional<Line> line = line_between(first->pixels, second->pixels);
    if (!line || missing(*first, *line, -1) < kMinMissing ||
        missing(*second, *line, 1) < kMinMissing)
      return std::nullopt;
    return MissingPlace{.first_features = static_cast<int>(first->features.size()),
                        .second_features = static_cast<int>(second->features.size())};
  }

 private:
  // The side of a pixel is positive where normal . pixel > offset.
  struct Line {
    cv::Point2d normal;
    double offset = 0;
    [[nodiscard]] double side_of(const cv::Point2d& pixel) const {
      return normal.dot(pixel) - offset;
    }
  };

  [[nodiscard]] std::optional<Fit> best_fit() const {
    if (matches_.size() < kMinSecondFeatures) return std::nullopt;
    std::vector<cv::Point2f> features;
    std::vector<cv::Point3d> positions;
    for (const PointMatch& match : matches_) {
      features.emplace_back(image_.features[at(match.feature)]);
      positions.emplace_back(geometry::to_cv(model_.points[at(match.point)].position));
    }
    const auto pose = absolute_pose(positions, undistorted(features, camera_), camera_,
                                    options_.pose_px, options_.seed);
    if (!pose) return std::nullopt;
    Fit fit;
    fit.pose = *pose;
    std::set<int> points;
    for (const PointMatch& match : matches_) {
      const cv::Point2d seen(image_.features[at(match.feature)]);
      const auto pixel = camera_.project(*pose * model_.points[at(match.point)].position);
      if (!pixel || cv::norm(*pixel - seen) > options_.pose_px) continue;
      if (fit.features.insert(match.feature).second) fit.pixels.push_back(seen);
      points.insert(match.point);
    }
    fit.points.assign(points.begin(), points.end());
    return fit;
  }

  // The line that separates two sets best: `first` on its positive side.
  [[nodiscard]] static std::optional<Line> line_between(const std::vector<cv::Point2d>& first,
                                                        const std::vector<cv::Point2d>& second) {
    double best = 0;
    Line line;
    for (int k = 0; k < kDirections; ++k) {
      const double angle = 2 * CV_PI * k / kDirections;
      const cv::Point2d normal(std::cos(angle), std::sin(angle));
      double separated = 0;
      double low = std::numeric_limits<double>::infinity();
      double high = -low;
      for (const cv::Point2d& a : first) {
        low = std::min(low, normal.dot(a));
        for (const cv::Point2d& b : second) separated += normal.dot(a) > normal.dot(b) ? 1 : 0;
      }
      for (const cv::Point2d& b : second) high = std::max(high, normal.dot(b));
      if (separated <= best) continue;
      best = separated;
      line = {normal, (low + high) / 2};
    }
    const auto all = static_cast<double>(first.size() * second.size());
    if (best < kMinSeparation * all) return std::nullopt;
    return line;
  }

  // Images of the model that show the points of a fit.
  [[nodiscard]] std::vector<int> near_images(const Fit& fit) const {
    std::vector<int> shared(model_.images.size(), 0);
    for (const int point : fit.points)
      for (const Observation& seen : model_.points[at(point)].track) ++shared[at(seen.image)];
    const int most = *std::max_element(shared.begin(), shared.end());
    std::vector<int> near;
    for (std::size_t i = 0; i < shared.size(); ++i)
      if (shared[i] >= std::max<double>(kMinSharedPoints, kMinNearShare * most))
        near.push_back(static_cast<int>(i));
    return near;
  }

  // The number of points that should be found on one side of the line, by the share that is found
  // on the other side.
  [[nodiscard]] double missing(const Fit& fit, const Line& line, double side) const {
    std::set<int> points;
    for (const int i : near_images(fit))
      for (const int point : model_.images[at(i)].points)
        if (point >= 0) points.insert(point);
    double there = 0;
    double here = 0;
    for (const int point : points) {
      const Eigen::Vector3d position = fit.pose * model_.points[at(point)].position;
      const auto pixel = camera_.project(position);
      if (!(position.z() > 0) || !pixel || pixel->x < 0 || pixel->y < 0 ||
          pixel->x > camera_.width || pixel->y > camera_.height)
        continue;
      (side * line.side_of(*pixel) > 0 ? there : here) += 1;
    }
    return here > 0 ? there * static_cast<double>(fit.features.size()) / here : 0;
  }

  const Image& image_;
  const Model& model_;
  const geometry::Camera& camera_;
  std::set<PointMatch> matches_;
  const MapperOptions& options_;
};

// For each image, whether a model contains it, and its matches do not contradict its pose there.
std::vector<bool> are_placed(std::size_t images, const std::vector<Pair>& pairs,
                             const std::vector<Model>& models) {
  std::vector<bool> placed(images, false);
  for (const Model& model : models) {
    std::vector<bool> here(images);
    for (std::size_t i = 0; i < images; ++i) here[i] = model.images[i].registered;
    for (const ContradictedImage& each : contradicted_images(pairs, model))
      here[at(each.image)] = false;
    for (std::size_t i = 0; i < images; ++i) placed[i] = placed[i] || here[i];
  }
  return placed;
}

// The points of a model that features of an image match in its images.
std::set<PointMatch> matches_with(const Model& model, int image,
                                  const std::vector<const Pair*>& pairs) {
  std::set<PointMatch> matches;
  for (const Pair* pair : pairs) {
    const bool is_first = pair->first == image;
    const Image& other = model.images[at(is_first ? pair->second : pair->first)];
    if (!other.registered) continue;
    for (const auto& inlier : pair->view.inliers) {
      const int point = other.points[at(is_first ? inlier.second : inlier.first)];
      if (point >= 0) matches.insert({is_first ? inlier.first : inlier.second, point});
    }
  }
  return matches;
}

// The models that lack the place which an image shows.
std::vector<MissingPlace> missing_places_of(int image, const std::vector<Image>& images,
                                            const std::vector<const Pair*>& pairs,
                                            const std::vector<Model>& models,
                                            const MapperOptions& options) {
  std::vector<MissingPlace> places;
  for (std::size_t m = 0; m < models.size(); ++m) {
    Comparison comparison(images[at(image)], models[m], matches_with(models[m], image, pairs),
                          options);
    if (!comparison.is_relevant()) continue;
    std::optional<MissingPlace> place = comparison.missing_place();
    if (!place) return {};
    place->image = image;
    place->model = static_cast<int>(m);
    places.push_back(*place);
  }
  return places;
}

}  // namespace

std::vector<MissingPlace> missing_places(const std::vector<Image>& images,
                                         const std::vector<Pair>& pairs,
                                         const std::vector<Model>& models,
                                         const MapperOptions& options) {
  std::vector<std::vector<const Pair*>> pairs_of(images.size());
  for (const Pair& pair : pairs) {
    if (pair.view.inliers.empty()) continue;
    pairs_of[at(pair.first)].push_back(&pair);
    pairs_of[at(pair.second)].push_back(&pair);
  }
  const std::vector<bool> placed = are_placed(images.size(), pairs, models);
  std::vector<MissingPlace> places;
  for (std::size_t i = 0; i < images.size(); ++i) {
    if (placed[i]) continue;
    for (const MissingPlace& place :
         missing_places_of(static_cast<int>(i), images, pairs_of[i], models, options))
      places.push_back(place);
  }
  return places;
}

void count_missing_places(const MapperInput& input, const MapperOptions& options,
                          Reconstruction& made) {
  for (ModelShape& shape : made.shapes) shape.missing_places = 0;
  for (const MissingPlace& place : missing_places(input.images, input.pairs, made.models, options))
    ++made.shapes[at(place.model)].missing_places;
}

}  // namespace tarsier::sfm
