// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/outcomes.h"

#include "tarsier/sfm/consistency/trust.h"
#include "tarsier/sfm/mapper/initial_pair.h"
#include "tarsier/sfm/mapper/missing_places.h"
#include "tarsier/sfm/mapper/model_filter.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace tarsier::sfm {
namespace {

// Weight of conflicts in a folded model: an image that a third of its neighbours contradict has no
// trust.
constexpr double kFoldedWeight = 3;

void order_models(int min_images, std::vector<Model>& models,
                  std::vector<std::shared_ptr<const ModelConflicts>>& conflicts) {
  struct SizedModel {
    ModelStatistics size;
    Model model;
    std::shared_ptr<const ModelConflicts> conflicts;
  };
  std::vector<SizedModel> sized;
  for (std::size_t m = 0; m < models.size(); ++m) {
    const ModelStatistics size = statistics_of(models[m]);
    if (size.registered >= min_images)
      sized.push_back({size, std::move(models[m]), std::move(conflicts[m])});
  }
  std::stable_sort(sized.begin(), sized.end(), [](const SizedModel& a, const SizedModel& b) {
    return a.size.registered != b.size.registered ? a.size.registered > b.size.registered
                                                  : a.size.observations > b.size.observations;
  });
  models.clear();
  conflicts.clear();
  for (SizedModel& each : sized) {
    models.push_back(std::move(each.model));
    conflicts.push_back(std::move(each.conflicts));
  }
}

std::string why_refused(PairRejection rejection, const PairEvidence& evidence) {
  switch (rejection) {
    case PairRejection::kOpenCycles:
      return "the relative rotations are inconsistent in every triplet of images that contains the "
             "pair";
    case PairRejection::kRotationError:
      return "its relative rotation contradicts those of the other pairs";
    case PairRejection::kModelConflict:
      return "a model with this pair superimposes different places";
    default:
      return fmt::format(
          "{} of {:.0f} distinctive features that are expected in both images were found in both: "
          "the images look alike, but show different places",
          evidence.found, evidence.expected);
  }
}

std::vector<RefusedPair> refused_pairs(const std::vector<Pair>& pairs,
                                       const std::vector<PairEvidence>& evidence,
                                       const std::vector<PairRejection>& rejections) {
  std::vector<RefusedPair> refused;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    if (!is_refused(rejections[k])) continue;
    refused.push_back({pairs[k].first, pairs[k].second,
                       static_cast<int>(pairs[k].view.inliers.size()),
                       why_refused(rejections[k], evidence[k]), rejections[k]});
  }
  return refused;
}

// Whether pairs made the model superimpose different places, as opposed to single images that lack
// points.
bool is_folded(const Model& model, const ModelConflicts& conflicts, const std::vector<Pair>& pairs,
               const std::vector<PairRejection>& rejections) {
  std::vector<const Pair*> standing;
  for (std::size_t k = 0; k < pairs.size(); ++k)
    if (!pairs[k].view.inliers.empty() && !is_refused(rejections[k])) standing.push_back(&pairs[k]);
  return !conflicting_pairs(model, conflicts, standing).empty();
}

// Trust for each image of a model, lower for near images that contradict each other.
std::vector<double> image_trust(const Model& model, const MapperInput& input,
                                const std::vector<PairRejection>& rejections, bool is_repetitive,
                                std::shared_ptr<const ModelConflicts> conflicts,
                                bool& has_conflicts) {
  std::vector<std::uint8_t> by_evidence(rejections.size(), 0);
  for (std::size_t k = 0; k < rejections.size(); ++k)
    by_evidence[k] = rejections[k] == PairRejection::kMissingFeatures ||
                             rejections[k] == PairRejection::kModelConflict
                         ? 1
                         : 0;
  std::vector<double> trust = trust_of(model, input.pairs, by_evidence);
  if (input.tracked) return trust;
  if (!conflicts) conflicts = std::make_shared<const ModelConflicts>(model);
  if (!conflicts->any(is_repetitive)) return trust;
  has_conflicts = true;
  const double weight = is_folded(model, *conflicts, input.pairs, rejections) ? kFoldedWeight : 1;
  for (std::size_t i = 0; i < trust.size(); ++i)
    trust[i] *= std::max(0.0, 1 - weight * conflicts->shares()[i]);
  return trust;
}

}  // namespace

void add_outcomes(const MapperInput& input, const MapperOptions& options,
                  const std::vector<PairEvidence>& evidence,
                  const std::vector<PairRejection>& rejections, bool is_repetitive,
                  std::vector<std::shared_ptr<const ModelConflicts>> conflicts,
                  Reconstruction& made) {
  order_models(options.min_images, made.models, conflicts);
  if (!made.models.empty()) {
    made.no_model.clear();
  } else if (made.no_model.empty()) {
    made.no_model = why_no_initial_pair(input.pairs, input.images, options);
  }
  made.refused = refused_pairs(input.pairs, evidence, rejections);
  std::vector<std::vector<double>> trust;  // for the images of each model
  for (std::size_t m = 0; m < made.models.size(); ++m) {
    const Model& model = made.models[m];
    trust.push_back(image_trust(model, input, rejections, is_repetitive, std::move(conflicts[m]),
                                made.has_conflicts));
    made.trust.push_back(model_trust(model, trust.back()));
    made.shapes.push_back(shape_of(model, input.pairs));
  }
  if (is_repetitive) {
    count_missing_places(input, options, made);
    made.has_conflicts =
        made.has_conflicts || std::any_of(made.shapes.begin(), made.shapes.end(), is_unreliable);
  }
  const std::vector<const Pair*> best = best_pairs(input.pairs, input.images.size());
  for (std::size_t i = 0; i < input.images.size(); ++i) {
    Outcome& outcome = made.outcomes[i];
    for (std::size_t m = 0; m < made.models.size() && !outcome.registered; ++m) {
      if (!made.models[m].images[i].registered) continue;
      outcome.registered = true;
      outcome.model = static_cast<int>(m);
      outcome.trust = trust[m][i];
      outcome.reason.clear();
    }
    if (outcome.registered || !outcome.reason.empty()) continue;
    outcome.reason = made.interrupted
                         ? "the run was interrupted before the image was processed"
                         : why_not_registered(best[i], input.images, static_cast<int>(i));
  }
}

}  // namespace tarsier::sfm
