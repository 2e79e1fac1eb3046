// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace tarsier::face::regression {

// Contiguous rows of single-precision numbers.
struct Rows {
  int columns = 0;
  std::vector<float> values;
  [[nodiscard]] int rows() const {
    return columns == 0 ? 0 : static_cast<int>(values.size() / static_cast<std::size_t>(columns));
  }
  [[nodiscard]] const float* row(int r) const {
    return values.data() + static_cast<std::size_t>(r) * static_cast<std::size_t>(columns);
  }
  [[nodiscard]] float* row(int r) {
    return values.data() + static_cast<std::size_t>(r) * static_cast<std::size_t>(columns);
  }
};

// left^T right over rows [begin, end): left.columns x right.columns. The order of summation does
// not depend on the number of threads. Uses OpenCV's threads.
[[nodiscard]] Eigen::MatrixXf cross_products(const Rows& left, const Rows& right, int begin,
                                             int end);

// W (D x k) that minimises |X W - Y|^2 + lambda |W|^2 given X^T X (overwritten) and X^T Y. The last
// row of W, of the constant feature, is not penalised.
[[nodiscard]] Eigen::MatrixXf ridge(Eigen::MatrixXf squares, const Eigen::MatrixXf& products,
                                    float lambda);

}  // namespace tarsier::face::regression
