// SPDX-License-Identifier: MIT
#include "tarsier/sfm/reconstruction/all_pairs.h"

#include "tarsier/core/at.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/consistency/model_conflicts.h"
#include "tarsier/sfm/consistency/pair_agreement.h"
#include "tarsier/sfm/consistency/trust.h"
#include "tarsier/sfm/mapper/incremental_mapper.h"
#include "tarsier/sfm/mapper/missing_places.h"

#include <algorithm>
#include <cstdint>
#include <set>
#include <utility>

namespace tarsier::sfm {
namespace {

// Weight of conflicts: an image that a fifth of its neighbours contradict has no trust.
constexpr double kConflictWeight = 5;

}  // namespace

Model retriangulated(const Model& model, const std::vector<const Pair*>& pairs,
                     const MapperInput& input, const MapperOptions& options) {
  std::vector<int> features;
  features.reserve(input.images.size());
  for (const Image& image : input.images)
    features.push_back(static_cast<int>(image.features.size()));
  Model start;
  start.images = input.images;
  start.cameras = input.cameras;
  IncrementalMapper mapper(std::move(start), make_tracks(pairs, features), input.descriptors,
                           input.kind, options);
  mapper.resume(model);
  return mapper.finished(input.colors);
}

void update_trust_by_all_pairs(const MapperInput& input, const MapperOptions& options,
                               const std::stop_token& stop, Reconstruction& reconstruction) {
  std::set<std::pair<int, int>> missing_features;  // pairs refused for missing evidence
  for (const RefusedPair& refused : reconstruction.refused)
    if (refused.rejection == PairRejection::kMissingFeatures ||
        refused.rejection == PairRejection::kModelConflict)
      missing_features.emplace(refused.first, refused.second);
  reconstruction.shapes.resize(reconstruction.models.size());
  for (std::size_t m = 0; m < reconstruction.models.size(); ++m) {
    const Model& model = reconstruction.models[m];
    std::vector<const Pair*> agreeing;
    std::vector<std::uint8_t> refused(input.pairs.size(), 1);
    for (std::size_t k = 0; k < input.pairs.size(); ++k) {
      throw_if_stopped(stop);
      const Pair& pair = input.pairs[k];
      if (!is_registered(model, pair) || !agrees(model, pair)) continue;
      agreeing.push_back(&pair);
      refused[k] = missing_features.contains({pair.first, pair.second}) ? 1 : 0;
    }
    std::vector<double> trust = trust_of(model, input.pairs, refused);
    throw_if_stopped(stop);
    const ModelConflicts conflicts(retriangulated(model, agreeing, input, options));
    for (std::size_t i = 0; i < trust.size(); ++i) {
      trust[i] *= std::max(0.0, 1 - kConflictWeight * conflicts.shares()[i]);
      Outcome& outcome = reconstruction.outcomes[i];
      if (outcome.model == static_cast<int>(m)) outcome.trust = trust[i];
    }
    reconstruction.trust[m] = model_trust(model, trust);
    reconstruction.shapes[m] = shape_of(model, input.pairs);
  }
  count_missing_places(input, options, reconstruction);
}

}  // namespace tarsier::sfm
