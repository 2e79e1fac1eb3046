// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/mapper/mapper.h"

#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

// What was mapped apart: models of parts of the images.
struct MappedPart {
  std::string name;  // for the log and the report
  // With the images and cameras of all parts (model_join.h).
  Model model;
};

struct MappedParts {
  std::vector<MappedPart> parts;
  // Pairs that were refused while a part was mapped, as indices into the pairs of the input.
  std::vector<std::size_t> refused_pairs;
  std::vector<std::string> reasons;  // of each image: why it is in no model; may be empty
  std::vector<std::string> log;      // of before
};

// Joins the parts (join_models()). Where the input has pairs, each model then goes on as one that began globally: points are
// made again of all pairs, what can join joins, except what another model has, all of it is adjusted and its tracks are
// extended. The result says which parts were joined and why others were not. Deterministic for any number of threads. Throws
// std::invalid_argument for parts whose images are not those of the input, Interrupted.
[[nodiscard]] Reconstruction map_joined(const MapperInput& input, const MapperOptions& options,
                                        const MappedParts& mapped, Progress& progress,
                                        const std::stop_token& stop);

}  // namespace tarsier::sfm
