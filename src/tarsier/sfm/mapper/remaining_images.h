// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/consistency/pair_rejection.h"
#include "tarsier/sfm/global/view_graph.h"
#include "tarsier/sfm/mapper/mapper_input.h"

#include <cstddef>
#include <map>
#include <vector>

// Internal to the mapper.
namespace tarsier::sfm {

// What is left to map while one model after another is made: images that are in no finished model,
// and their verified pairs that are not refused. Refers to the input, which must outlive it.
class RemainingImages {
 public:
  explicit RemainingImages(const MapperInput& input);

  // The images of finished models.
  [[nodiscard]] const std::vector<bool>& in_models() const { return in_models_; }
  void add_finished(const Model& model);

  // For each pair of the input.
  [[nodiscard]] const std::vector<PairRejection>& rejections() const { return rejections_; }
  void set_rejections(std::vector<PairRejection> rejections);
  void reject(std::size_t pair, PairRejection reason) { rejections_[pair] = reason; }
  // `pair`: of the input.
  void reject(const Pair& pair, PairRejection reason);
  // Pairs that contradicted others of their cycles are used again.
  void clear_cycle_rejections();

  [[nodiscard]] bool contains(const Pair& pair) const;  // `pair`: of the input
  [[nodiscard]] std::vector<const Pair*> pairs() const;

  // Components of the images by these pairs, and by `connected`: images that know their relative
  // poses (for each image, not 0; may be empty).
  [[nodiscard]] Components components(const std::vector<char>& connected) const;
  // The remaining pairs of each component, by its root. Only those that can start a model.
  [[nodiscard]] std::map<int, std::vector<std::size_t>> pairs_by_component(
      Components& components) const;
  // A model without poses and points: the features of this component's images only.
  [[nodiscard]] Model model_of(Components& components, int root) const;
  // Its pairs.
  [[nodiscard]] std::vector<const Pair*> pairs_of(Components& components, int root) const;

 private:
  const MapperInput& input_;
  std::vector<bool> in_models_;
  std::vector<PairRejection> rejections_;
};

}  // namespace tarsier::sfm
