// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

namespace tarsier::linalg {

// Nested dissection (George, Nested dissection of a regular finite element mesh, 1973): an
// elimination order with little fill in the Cholesky decomposition of a sparse matrix.
// `neighbours`: for each variable, those with which it shares a nonzero block. `variables`: the
// variables to order; others are ignored. Each part is cut into two halves without common nonzeros,
// and a separator, which follows both. The separator is a level set: the variables at one distance
// from a peripheral one (George and Liu, An automatic nested dissection algorithm for irregular
// finite element problems, 1978).
[[nodiscard]] std::vector<int> dissection_order(const std::vector<std::vector<int>>& neighbours,
                                                const std::vector<int>& variables);

}  // namespace tarsier::linalg
