// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/remaining_images.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"
#include "tarsier/sfm/mapper/model_parts.h"

#include <utility>

namespace tarsier::sfm {

RemainingImages::RemainingImages(const MapperInput& input)
    : input_(input),
      in_models_(input.images.size(), false),
      rejections_(input.pairs.size(), PairRejection::kNone) {}

void RemainingImages::add_finished(const Model& model) {
  for (std::size_t i = 0; i < in_models_.size(); ++i)
    in_models_[i] = in_models_[i] || model.images[i].registered;
}

void RemainingImages::set_rejections(std::vector<PairRejection> rejections) {
  TARSIER_REQUIRE(rejections.size() == input_.pairs.size(), "{} rejections of {} pairs",
                  rejections.size(), input_.pairs.size());
  rejections_ = std::move(rejections);
}

void RemainingImages::reject(const Pair& pair, PairRejection reason) {
  reject(static_cast<std::size_t>(&pair - input_.pairs.data()), reason);
}

void RemainingImages::clear_cycle_rejections() {
  for (PairRejection& rejection : rejections_)
    if (rejection == PairRejection::kOpenCycles || rejection == PairRejection::kRotationError)
      rejection = PairRejection::kNone;
}

bool RemainingImages::contains(const Pair& pair) const {
  return !pair.view.inliers.empty() && !in_models_[at(pair.first)] &&
         !in_models_[at(pair.second)] &&
         !is_refused(rejections_[static_cast<std::size_t>(&pair - input_.pairs.data())]);
}

std::vector<const Pair*> RemainingImages::pairs() const {
  std::vector<const Pair*> result;
  for (const Pair& pair : input_.pairs)
    if (contains(pair)) result.push_back(&pair);
  return result;
}

Components RemainingImages::components(const std::vector<char>& connected) const {
  Components components(input_.images.size());
  for (const Pair& pair : input_.pairs)
    if (contains(pair)) components.join(pair.first, pair.second);
  int first = -1;
  for (std::size_t i = 0; i < connected.size(); ++i) {
    if (connected[i] == 0) continue;
    if (first < 0) first = static_cast<int>(i);
    components.join(first, static_cast<int>(i));
  }
  return components;
}

std::map<int, std::vector<std::size_t>> RemainingImages::pairs_by_component(
    Components& components) const {
  std::map<int, std::vector<std::size_t>> result;
  for (std::size_t k = 0; k < input_.pairs.size(); ++k)
    if (contains(input_.pairs[k]) && rejections_[k] == PairRejection::kNone)
      result[components.root(input_.pairs[k].first)].push_back(k);
  return result;
}

Model RemainingImages::model_of(Components& components, int root) const {
  std::vector<char> has_features(input_.images.size());
  for (std::size_t i = 0; i < has_features.size(); ++i)
    has_features[i] = components.root(static_cast<int>(i)) == root ? 1 : 0;
  return model_with_features(input_.cameras, input_.images, has_features);
}

std::vector<const Pair*> RemainingImages::pairs_of(Components& components, int root) const {
  std::vector<const Pair*> result;
  for (const Pair& pair : input_.pairs)
    if (contains(pair) && components.root(pair.first) == root) result.push_back(&pair);
  return result;
}

}  // namespace tarsier::sfm
