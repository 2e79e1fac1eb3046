// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <vector>

namespace tarsier::sfm {

// Of `points` (indices in the model, ascending) a share that is spread over `images`: each of them shows `per_image` of the
// chosen ones at least, or all of `points` that it shows. Points are taken in an order that mixes them, the same in each
// run; what is chosen is ascending.
[[nodiscard]] std::vector<int> select_points(const Model& model, const std::vector<int>& points,
                                             const std::vector<int>& images, int per_image);

}  // namespace tarsier::sfm
