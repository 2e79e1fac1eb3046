// SPDX-License-Identifier: MIT
#include "tarsier/sfm/reconstruction/strong_pairs.h"

#include "tarsier/core/at.h"
#include "tarsier/sfm/consistency/joined_parts.h"
#include "tarsier/sfm/consistency/pair_agreement.h"
#include "tarsier/sfm/consistency/trust.h"
#include "tarsier/sfm/mapper/model_filter.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <string>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr double kInlierRatios[] = {0.9, 0.8, 0.6, 0};  // of the inliers of the strongest pair
constexpr int kUncheckedImages = 2;                     // images of a model that any poses fit
// factor of a score: parts contradict themselves less than a whole
constexpr double kEqualScoreRatio = 0.9;
constexpr double kJoinedScoreRatio = 0.8;  // the same, where a whole has the models of the parts

// The agreement of models that contain both images of a pair.
struct ModelAgreement {
  bool is_supported = false;
  bool is_contradicted = false;
};

ModelAgreement agreement_with(const Pair& pair, const std::vector<Model>& models) {
  ModelAgreement result;
  for (const Model& model : models) {
    if (!model.images[at(pair.first)].registered || !model.images[at(pair.second)].registered)
      continue;
    (agrees(model, pair) ? result.is_supported : result.is_contradicted) = true;
  }
  return result;
}

double score_without_shapes(const Reconstruction& reconstruction) {
  return score_of(reconstruction, std::vector<double>(reconstruction.models.size(), 1));
}

// Whether `whole` joins the models of `parts` at nearly the same score.
bool is_joined(const Reconstruction& whole, const Reconstruction& parts,
               const std::vector<Pair>& pairs) {
  return score_of(whole) >= kJoinedScoreRatio * score_of(parts) &&
         joins_parts(whole.models, parts.models, pairs);
}

}  // namespace

std::vector<Pair> strong_pairs(const std::vector<Pair>& pairs, std::size_t images, double share) {
  const std::vector<std::size_t> strongest = max_inliers_of_images(pairs, images);
  std::vector<Pair> strong = pairs;
  for (Pair& pair : strong) {
    const auto inliers = static_cast<double>(pair.view.inliers.size());
    const std::size_t of_either = std::min(strongest[at(pair.first)], strongest[at(pair.second)]);
    if (inliers < share * static_cast<double>(of_either)) pair.view.inliers = {};
  }
  return strong;
}

std::vector<Pair> without_contradicted(const std::vector<Pair>& pairs,
                                       const std::vector<Model>& models) {
  std::set<std::size_t> missed;
  for (const Model& model : models)
    for (const ModelShape::MissedPair& each : shape_of(model, pairs).missed_pairs)
      missed.insert(each.pair);
  std::vector<Pair> result = pairs;
  for (std::size_t k = 0; k < pairs.size(); ++k)
    if (agreement_with(pairs[k], models).is_contradicted && !missed.contains(k))
      result[k].view.inliers = {};
  return result;
}

std::vector<Pair> with_supported(const std::vector<Pair>& some, const std::vector<Pair>& pairs,
                                 const std::vector<Model>& models) {
  std::vector<Pair> result = some;
  for (std::size_t k = 0; k < result.size(); ++k)
    if (result[k].view.inliers.empty() && agreement_with(pairs[k], models).is_supported)
      result[k] = pairs[k];
  return result;
}

void lower_trust(const std::vector<Pair>& pairs, const std::vector<PatchRejection>& rejections,
                 Reconstruction& reconstruction) {
  if (std::all_of(rejections.begin(), rejections.end(),
                  [](const PatchRejection& rejection) { return !rejection.patches_differ; }))
    return;
  struct Count {
    int supported = 0;
    int rejected = 0;
  };
  for (std::size_t m = 0; m < reconstruction.models.size(); ++m) {
    const Model& model = reconstruction.models[m];
    std::vector<Count> counts(model.images.size());
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      const Pair& pair = pairs[k];
      if (pair.view.inliers.empty() || !model.images[at(pair.first)].registered ||
          !model.images[at(pair.second)].registered || !agrees(model, pair))
        continue;
      for (const int image : {pair.first, pair.second}) {
        ++counts[at(image)].supported;
        if (rejections[k].patches_differ) ++counts[at(image)].rejected;
      }
    }
    std::vector<double> trust(model.images.size(), 0);
    for (std::size_t i = 0; i < counts.size(); ++i) {
      if (!model.images[i].registered) continue;
      Outcome& outcome = reconstruction.outcomes[i];
      trust[i] =
          outcome.trust * (counts[i].supported == 0
                               ? 1
                               : 1 - static_cast<double>(counts[i].rejected) / counts[i].supported);
      if (outcome.model == static_cast<int>(m)) outcome.trust = trust[i];
    }
    reconstruction.trust[m] = model_trust(model, trust);
  }
}

double score_of(const Reconstruction& reconstruction) {
  std::vector<double> factors;
  factors.reserve(reconstruction.shapes.size());
  for (const ModelShape& shape : reconstruction.shapes)
    factors.push_back(is_unreliable(shape) ? kUnreliableTrustFactor : 1);
  return score_of(reconstruction, factors);
}

double score_of(const Reconstruction& reconstruction, const std::vector<double>& factors) {
  double sum = 0;
  for (std::size_t m = 0; m < reconstruction.models.size(); ++m)
    sum += reconstruction.trust[m] *
           std::max(0, statistics_of(reconstruction.models[m]).registered - kUncheckedImages) *
           factors[m];
  return sum;
}

bool is_as_good(const Reconstruction& one, const Reconstruction& other, double min_score_ratio) {
  const double share = one.models.size() < other.models.size() ? min_score_ratio : 1;
  return score_of(one) >= share * score_of(other);
}

Reconstruction better_of(const std::vector<Pair>& pairs, Reconstruction first,
                         Reconstruction second) {
  const double before = score_of(first);
  const double after = score_of(second);
  const bool is_better =
      is_joined(second, first, pairs) || (after > before && !is_joined(first, second, pairs));
  std::vector<std::string> log = std::move(first.log);
  log.insert(log.end(), second.log.begin(), second.log.end());
  log.push_back(
      fmt::format("score of the models: first {:.1f}, second {:.1f}; the {} models are used",
                  before, after, is_better ? "second" : "first"));
  const int resumed = first.resumed;
  Reconstruction better = std::move(is_better ? second : first);
  better.resumed = resumed;
  better.log = std::move(log);
  return better;
}

Reconstruction map_strong_pairs_first(const std::vector<Pair>& pairs,
                                      const std::vector<PatchRejection>& rejections,
                                      std::size_t images, const MapPairs& map) {
  std::vector<std::string> log{
      "the models still superimpose different places: the images are mapped again"};
  std::vector<Pair> remaining = pairs;
  for (std::size_t k = 0; k < pairs.size(); ++k)
    if (rejections[k]) remaining[k].view.inliers = {};
  std::vector<Pair> used;
  Reconstruction best;
  double last = 0;  // score, regardless of shapes
  // Where pixels distinguish places, only few of the remaining pairs are wrong.
  const bool is_distinguished =
      std::any_of(rejections.begin(), rejections.end(),
                  [](const PatchRejection& rejection) { return rejection.patches_differ; });
  const double min_score_ratio = is_distinguished ? kEqualScoreRatio : 1;
  for (const double share : kInlierRatios) {
    std::vector<Pair> strong = strong_pairs(remaining, images, share);
    Reconstruction attempt = map(strong);
    log.push_back(
        fmt::format("mapping with pairs of at least {} times the inliers of the strongest pair: {} "
                    "models, score {:.1f}",
                    share, attempt.models.size(), score_of(attempt)));
    const double score = score_without_shapes(attempt);
    const bool is_joining = is_joined(attempt, best, pairs);
    if (!is_joining && score < min_score_ratio * last) break;
    last = is_joining ? score : std::max(last, score);
    remaining = without_contradicted(remaining, attempt.models);
    if (!is_joining && !is_as_good(attempt, best, min_score_ratio)) continue;
    best = std::move(attempt);
    used = std::move(strong);
  }
  std::vector<Pair> supported =
      with_supported(used, without_contradicted(pairs, best.models), best.models);
  Reconstruction all = map(supported);
  if (is_joined(all, best, pairs) ||
      (score_of(all) >= score_of(best) && !is_joined(best, all, pairs))) {
    best = std::move(all);
    used = std::move(supported);
  }
  const std::string reason =
      "the pair has few inliers, and the models from stronger pairs do not agree with it";
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    const Pair& pair = pairs[k];
    if (pair.view.inliers.empty() || !used[k].view.inliers.empty()) continue;
    best.refused.push_back({pair.first, pair.second, static_cast<int>(pair.view.inliers.size()),
                            rejections[k] ? rejections[k].reason : reason, PairRejection::kNone,
                            rejections[k].patches_differ});
  }
  best.log.insert(best.log.begin(), log.begin(), log.end());
  return best;
}

}  // namespace tarsier::sfm
