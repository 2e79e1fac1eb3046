// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/features/mapped_store.h"
#include "tarsier/sfm/pipelines/cache.h"
#include "tarsier/sfm/pipelines/image_features.h"
#include "tarsier/sfm/pipelines/pipeline.h"
#include "tarsier/sfm/pipelines/start_model.h"

#include <optional>
#include <stop_token>
#include <vector>

// The steps of the pipeline before the mapping: the features of all images, and their matches.
namespace tarsier::sfm {

// Features of all readable images, one image after the other: each uses all threads. Sets the
// reports of `result`. With a database or optical flow, sets also its pairs, whose matches are not
// verified yet.
[[nodiscard]] std::vector<ImageFeatures> find_all_features(
    const std::vector<Input>& inputs, const PipelineOptions& options, const Cache& cache,
    const std::optional<StartModel>& start, MappedStore& store, Progress& progress,
    const std::stop_token& stop, PipelineResult& result);

// Loads the results of another program (PipelineHooks::matched).
[[nodiscard]] std::vector<ImageFeatures> load_all(const PipelineHooks& hooks, MappedStore& store,
                                                  PipelineResult& result);

// Compares the images of all pairs of `result`. The pairs of an image are cached as soon as all of
// them are done. `has_matches`: the pairs have matches already, which are verified.
void compare_all(const std::vector<Input>& inputs, const std::vector<ImageFeatures>& images,
                 bool has_matches, const PipelineOptions& options, const Cache& cache,
                 const PipelineHooks& hooks, MappedStore& store, Progress& progress,
                 const std::stop_token& stop, PipelineResult& result);

}  // namespace tarsier::sfm
