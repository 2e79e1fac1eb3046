// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/contradicted_images.h"

#include "tarsier/core/at.h"
#include "tarsier/sfm/consistency/pair_agreement.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr int kMinTrustedPoints = 50;  // an image with as many points is never removed
constexpr double kMinExplainedShare = 0.5;
constexpr double kMinPairShare = 0.8;  // share of a pair's inliers that are explained
constexpr double kMaxMatchErrorPx = 2;
constexpr int kMinModelImages = 8;

int registered_images(const Model& model) {
  return static_cast<int>(std::count_if(model.images.begin(), model.images.end(),
                                        [](const Image& image) { return image.registered; }));
}

// Removes all observations of images that are not registered, and points with fewer than two
// observations.
void remove_unregistered(Model& model) {
  std::vector<Point> points;
  for (Point& point : model.points) {
    std::erase_if(point.track, [&](const Observation& observation) {
      return !model.images[at(observation.image)].registered;
    });
    if (point.track.size() >= 2) points.push_back(std::move(point));
  }
  model.points = std::move(points);
  for (Image& image : model.images) std::fill(image.points.begin(), image.points.end(), -1);
  for (std::size_t p = 0; p < model.points.size(); ++p)
    for (const Observation& observation : model.points[p].track)
      model.images[at(observation.image)].points[at(observation.feature)] = static_cast<int>(p);
}

// Sorts the models by their number of images, the largest first.
void order_by_size(Reconstruction& made) {
  std::vector<int> sizes;
  sizes.reserve(made.models.size());
  for (const Model& model : made.models) sizes.push_back(registered_images(model));
  std::vector<int> order(sizes.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return sizes[at(a)] > sizes[at(b)]; });
  std::vector<Model> models;
  std::vector<double> trust;
  std::vector<ModelShape> shapes;
  std::vector<int> new_index(order.size());
  for (std::size_t k = 0; k < order.size(); ++k) {
    const std::size_t m = at(order[k]);
    models.push_back(std::move(made.models[m]));
    trust.push_back(made.trust[m]);
    shapes.push_back(made.shapes[m]);
    new_index[m] = static_cast<int>(k);
  }
  made.models = std::move(models);
  made.trust = std::move(trust);
  made.shapes = std::move(shapes);
  for (Outcome& outcome : made.outcomes)
    if (outcome.registered) outcome.model = new_index[at(outcome.model)];
}

}  // namespace

std::vector<ContradictedImage> contradicted_images(const std::vector<Pair>& pairs,
                                                   const Model& model) {
  std::vector<ContradictedImage> candidates;
  std::vector<int> candidate_of(model.images.size(), -1);
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    const Image& image = model.images[i];
    if (!image.registered) continue;
    const auto points = static_cast<int>(
        std::count_if(image.points.begin(), image.points.end(), [](int p) { return p >= 0; }));
    if (points >= kMinTrustedPoints) continue;
    candidate_of[i] = static_cast<int>(candidates.size());
    candidates.push_back({.image = static_cast<int>(i), .points = points});
  }
  for (const Pair& pair : pairs) {
    if (candidate_of[at(pair.first)] < 0 && candidate_of[at(pair.second)] < 0) continue;
    if (pair.view.inliers.empty() || !model.images[at(pair.first)].registered ||
        !model.images[at(pair.second)].registered)
      continue;
    const std::size_t inliers = pair.view.inliers.size();
    const bool is_explained =
        static_cast<double>(explained_matches(model, pair, kMaxMatchErrorPx)) >=
        kMinPairShare * static_cast<double>(inliers);
    for (const int image : {pair.first, pair.second}) {
      if (candidate_of[at(image)] < 0) continue;
      ContradictedImage& candidate = candidates[at(candidate_of[at(image)])];
      candidate.inliers += inliers;
      if (is_explained) candidate.explained += inliers;
    }
  }
  std::erase_if(candidates, [](const ContradictedImage& candidate) {
    return static_cast<double>(candidate.explained) >=
           kMinExplainedShare * static_cast<double>(candidate.inliers);
  });
  return candidates;
}

std::vector<ContradictedImage> remove_contradicted_images(const std::vector<Pair>& pairs,
                                                          Model& model) {
  std::vector<ContradictedImage> contradicted = contradicted_images(pairs, model);
  const int remaining = registered_images(model) - static_cast<int>(contradicted.size());
  if (contradicted.empty() || remaining < kMinModelImages) return {};
  for (const ContradictedImage& removed : contradicted) {
    Image& image = model.images[at(removed.image)];
    image.registered = false;
    image.pose = {};
    image.features.clear();
    image.sizes.clear();
    image.points.clear();
  }
  remove_unregistered(model);
  return contradicted;
}

void remove_contradicted_images(const std::vector<Pair>& pairs, Reconstruction& made) {
  for (std::size_t m = 0; m < made.models.size(); ++m) {
    const std::vector<ContradictedImage> removed =
        remove_contradicted_images(pairs, made.models[m]);
    if (removed.empty()) continue;
    for (const ContradictedImage& each : removed) {
      made.outcomes[at(each.image)] = {
          .reason = fmt::format("its pose is not reliable: it observes only {} points, and fits {} "
                                "of the {} verified matches with other images of the model",
                                each.points, each.explained, each.inliers)};
    }
    made.log.push_back(fmt::format(
        "{} of {} images are removed from a model: they observe few points, and most of their "
        "verified matches contradict their poses",
        removed.size(),
        removed.size() + static_cast<std::size_t>(registered_images(made.models[m]))));
  }
  order_by_size(made);
}

}  // namespace tarsier::sfm
