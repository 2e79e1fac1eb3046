// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

namespace tarsier::linalg {

// Nested dissection (George, Nested dissection of a regular finite element mesh, 1973): an order in which Cholesky's
// decomposition of a sparse matrix fills little. `neighbours`: of each variable those that it shares a number of the matrix
// with. `variables`: those that are put in order; others count as absent. Each part is cut into two halves that share no
// number, and a separator, which follows both: variables at one distance from a far one (George and Liu, An automatic nested
// dissection algorithm for irregular finite element problems, 1978).
[[nodiscard]] std::vector<int> dissection_order(const std::vector<std::vector<int>>& neighbours,
                                                const std::vector<int>& variables);

}  // namespace tarsier::linalg
