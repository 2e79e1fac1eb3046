// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/strong_pairs.h"

#include "tarsier/sfm/mapper/trust.h"

#include <algorithm>
#include <cmath>

namespace tarsier::sfm {
namespace {

constexpr double kLarge = 1.06;  // above 1: images in one model are better than in two

std::size_t at(int i) { return static_cast<std::size_t>(i); }

// What the models that have both images of a pair say.
struct Judgement {
  bool is_supported = false;
  bool is_contradicted = false;
};

Judgement judged(const Pair& pair, const std::vector<Model>& models) {
  Judgement result;
  for (const Model& model : models) {
    if (!model.images[at(pair.first)].registered || !model.images[at(pair.second)].registered)
      continue;
    (agrees(model, pair) ? result.is_supported : result.is_contradicted) = true;
  }
  return result;
}

}  // namespace

std::vector<Pair> strong_pairs(const std::vector<Pair>& pairs, std::size_t images, double share) {
  std::vector<std::size_t> strongest(images, 0);
  for (const Pair& pair : pairs)
    for (const int image : {pair.first, pair.second})
      strongest[at(image)] = std::max(strongest[at(image)], pair.view.inliers.size());
  std::vector<Pair> strong = pairs;
  for (Pair& pair : strong) {
    const auto inliers = static_cast<double>(pair.view.inliers.size());
    const std::size_t of_either = std::min(strongest[at(pair.first)], strongest[at(pair.second)]);
    if (inliers < share * static_cast<double>(of_either)) pair.view.inliers.clear();
  }
  return strong;
}

std::vector<Pair> without_contradicted(const std::vector<Pair>& pairs,
                                       const std::vector<Model>& models) {
  std::vector<Pair> result = pairs;
  for (Pair& pair : result)
    if (judged(pair, models).is_contradicted) pair.view.inliers.clear();
  return result;
}

std::vector<Pair> with_supported(const std::vector<Pair>& some, const std::vector<Pair>& pairs,
                                 const std::vector<Model>& models) {
  std::vector<Pair> result = some;
  for (std::size_t k = 0; k < result.size(); ++k)
    if (result[k].view.inliers.empty() && judged(pairs[k], models).is_supported)
      result[k] = pairs[k];
  return result;
}

double score_of(const Reconstruction& reconstruction) {
  double sum = 0;
  for (std::size_t m = 0; m < reconstruction.models.size(); ++m)
    sum += reconstruction.trust[m] *
           std::pow(statistics_of(reconstruction.models[m]).registered, kLarge);
  return sum;
}

}  // namespace tarsier::sfm
