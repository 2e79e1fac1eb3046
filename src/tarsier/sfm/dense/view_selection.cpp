// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/view_selection.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"

#include <Eigen/Geometry>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr int kParts = 12;
constexpr std::size_t kMaxPairsPerPoint = 40;  // per image and point, pairs with others
constexpr int kAngles = 180;
constexpr double kAngleStep = 0.5;  // degrees

// The common points of two images. Of fixed size, as a model may have millions of such points.
struct Pair {
  // for parts of the reference's image: sum of the weights
  std::array<float, kParts * kParts> parts{};
  std::array<std::uint32_t, kAngles> angles{};  // histogram of the angles of the points
  int shared = 0;

  void count(int part, double angle_deg, double weight) {
    parts[static_cast<std::size_t>(part)] += static_cast<float>(weight);
    const double bin = std::clamp(angle_deg / kAngleStep, 0.0, kAngles - 1.0);
    ++angles[static_cast<std::size_t>(bin)];
    ++shared;
  }
  // Accurate to half a step.
  [[nodiscard]] double median_angle() const {
    std::uint32_t below = 0;
    for (int i = 0; i < kAngles; ++i) {
      below += angles[static_cast<std::size_t>(i)];
      if (2 * below > static_cast<std::uint32_t>(shared)) return (i + 0.5) * kAngleStep;
    }
    return 0;
  }
};

double weight_of(double angle_deg, double enlargement, const ViewSelectionOptions& options) {
  const double difference = angle_deg - options.good_angle_deg;
  const double spread = options.good_angle_deg * (difference < 0 ? 0.5 : 1.5);
  return std::exp(-difference * difference / (2 * spread * spread)) / (enlargement * enlargement);
}

int part_of(const geometry::Camera& camera, const cv::Point2d& pixel) {
  const int x = std::clamp(static_cast<int>(pixel.x / camera.width * kParts), 0, kParts - 1);
  const int y = std::clamp(static_cast<int>(pixel.y / camera.height * kParts), 0, kParts - 1);
  return y * kParts + x;
}

class Selector {
 public:
  Selector(const Model& model, const ViewSelectionOptions& options)
      : model_(model), options_(options), pairs_(model.images.size()) {
    for (const Image& image : model.images) {
      TARSIER_REQUIRE(image.registered && image.camera >= 0 &&
                          static_cast<std::size_t>(image.camera) < model.cameras.size(),
                      "'{}' is not registered", image.name);
      centers_.push_back(image.pose.center());
    }
  }

  std::vector<ViewChoice> run(const std::stop_token& stop) {
    std::vector<ViewChoice> choices(model_.images.size());
    for (const Point& point : model_.points) {
      throw_if_stopped(stop);
      if (point.position.allFinite()) add(point, choices);
    }
    for (std::size_t i = 0; i < choices.size(); ++i) {
      set_depths(choices[i]);
      choose(static_cast<int>(i), choices[i]);
    }
    return choices;
  }

 private:
  struct PointObservation {
    int image = 0;
    double px_per_unit = 0;
    int part = 0;
  };

  void add(const Point& point, std::vector<ViewChoice>& choices) {
    std::vector<PointObservation> observed;
    for (const auto& [i, feature] : point.track) {
      const Image& image = model_.images[static_cast<std::size_t>(i)];
      const geometry::Camera& camera = model_.cameras[static_cast<std::size_t>(image.camera)];
      const Eigen::Vector3d in_camera = image.pose * point.position;
      const auto pixel = camera.project(in_camera);
      if (!pixel || !(pixel->x > -0.5 && pixel->y > -0.5 && pixel->x < camera.width - 0.5 &&
                      pixel->y < camera.height - 0.5))
        continue;
      observed.push_back({i, camera.fx / in_camera.z(), part_of(camera, *pixel)});
      choices[static_cast<std::size_t>(i)].known.push_back({*pixel, in_camera.z()});
    }
    for (std::size_t a = 0; a < observed.size(); ++a) {
      for (std::size_t b = a + 1; b < std::min(observed.size(), a + 1 + kMaxPairsPerPoint); ++b) {
        const Eigen::Vector3d to_a =
            centers_[static_cast<std::size_t>(observed[a].image)] - point.position;
        const Eigen::Vector3d to_b =
            centers_[static_cast<std::size_t>(observed[b].image)] - point.position;
        const double angle =
            std::atan2(to_a.cross(to_b).norm(), to_a.dot(to_b)) * kDegreesPerRadian;
        const double ratio = observed[a].px_per_unit / observed[b].px_per_unit;
        const double weight = weight_of(angle, std::max(ratio, 1 / ratio), options_);
        count(observed[a], observed[b].image, angle, weight);
        count(observed[b], observed[a].image, angle, weight);
      }
    }
  }

  void count(const PointObservation& observed, int other, double angle, double weight) {
    pairs_[static_cast<std::size_t>(observed.image)][other].count(observed.part, angle, weight);
  }

  void set_depths(ViewChoice& choice) const {
    if (choice.known.empty()) return;
    std::vector<double> inverse;
    inverse.reserve(choice.known.size());
    for (const KnownDepth& known : choice.known) inverse.push_back(1 / known.depth);
    std::sort(inverse.begin(), inverse.end());
    const auto at = [&](double part) {
      return inverse[static_cast<std::size_t>(part * static_cast<double>(inverse.size() - 1) +
                                              0.5)];
    };
    choice.min_depth = (1 - options_.depth_margin) / at(0.99);
    choice.max_depth = 1 / (at(0.01) * (1 - options_.depth_margin));
  }

  void choose(int index, ViewChoice& choice) const {
    const auto& pairs = pairs_[static_cast<std::size_t>(index)];
    std::vector<ViewChoice::Source> candidates;
    int narrow_pairs = 0;
    for (const auto& [other, pair] : pairs) {
      if (pair.shared < options_.min_shared_points) continue;
      const double median = pair.median_angle();
      if (median < options_.min_angle_deg) ++narrow_pairs;
      if (median < options_.min_angle_deg || median > options_.max_angle_deg) continue;
      double score = 0;
      for (const float weight : pair.parts) score += std::sqrt(static_cast<double>(weight));
      candidates.push_back({other, score, pair.shared, median});
    }
    select_sources(index, candidates, choice);
    if (!choice.sources.empty()) return;
    if (choice.known.empty())
      choice.reason = "the image observes no point of the model";
    else if (narrow_pairs > 0)
      choice.reason = fmt::format(
          "the image was taken from the same position as the others: triangulation angles are "
          "below {} degrees",
          options_.min_angle_deg);
    else
      choice.reason = fmt::format("no other image has {} or more points in common with it",
                                  options_.min_shared_points);
  }

  // The angle between two sources, as seen from the middle of what the image sees.
  [[nodiscard]] double angle_between(int reference, int a, int b, double depth) const {
    const Image& image = model_.images[static_cast<std::size_t>(reference)];
    const Eigen::Vector3d center = image.pose.inverse() * Eigen::Vector3d(0, 0, depth);
    const Eigen::Vector3d to_a = centers_[static_cast<std::size_t>(a)] - center;
    const Eigen::Vector3d to_b = centers_[static_cast<std::size_t>(b)] - center;
    return std::atan2(to_a.cross(to_b).norm(), to_a.dot(to_b)) * kDegreesPerRadian;
  }

  void select_sources(int index, std::vector<ViewChoice::Source> candidates,
                      ViewChoice& choice) const {
    std::sort(candidates.begin(), candidates.end(), [](const auto& a, const auto& b) {
      return a.score != b.score ? a.score > b.score : a.image < b.image;
    });
    const double depth =
        2 / (1 / std::max(choice.min_depth, 1e-12) + 1 / std::max(choice.max_depth, 1e-12));
    while (static_cast<int>(choice.sources.size()) < options_.views && !candidates.empty()) {
      const auto value = [&](const ViewChoice::Source& candidate) {
        double result = candidate.score;
        for (const ViewChoice::Source& chosen : choice.sources) {
          if (angle_between(index, candidate.image, chosen.image, depth) <
              options_.good_angle_deg / 3)
            result *= 0.5;
        }
        return result;
      };
      const auto best =
          std::max_element(candidates.begin(), candidates.end(),
                           [&](const auto& a, const auto& b) { return value(a) < value(b); });
      choice.sources.push_back(*best);
      candidates.erase(best);
    }
  }

  const Model& model_;
  const ViewSelectionOptions& options_;
  std::vector<Eigen::Vector3d> centers_;
  std::vector<std::map<int, Pair>> pairs_;  // for each image, by the other image
};

}  // namespace

std::vector<ViewChoice> select_views(const Model& model, const ViewSelectionOptions& options,
                                     const std::stop_token& stop) {
  options.check();
  return Selector(model, options).run(stop);
}

}  // namespace tarsier::sfm
