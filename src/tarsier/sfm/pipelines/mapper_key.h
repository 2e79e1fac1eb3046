// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/pipelines/image_features.h"

#include <optional>
#include <string>
#include <vector>

// The name of the mapper's checkpoint in the cache.
namespace tarsier::sfm {

// Key of all inputs of the mapper. `names` are those of `images`.
[[nodiscard]] std::string mapper_key(const std::vector<ImageFeatures>& images,
                                     const std::vector<std::string>& names,
                                     const ImageSet& image_set, const std::vector<Pair>& pairs,
                                     const std::optional<StartPoses>& start,
                                     const PipelineOptions& options);

}  // namespace tarsier::sfm
