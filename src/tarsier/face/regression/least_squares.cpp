// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/least_squares.h"

#include "tarsier/core/require.h"
#include "tarsier/linalg/block_cholesky.h"
#include "tarsier/linalg/gemm.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <stdexcept>

namespace tarsier::face::regression {

Eigen::MatrixXf cross_products(const Rows& left, const Rows& right, int begin, int end) {
  TARSIER_REQUIRE(left.rows() == right.rows() && begin >= 0 && begin <= end && end <= left.rows(),
                  "{} and {} rows, {}..{}", left.rows(), right.rows(), begin, end);
  constexpr int kBlock = 256;  // rows summed in single precision before accumulation
  constexpr int kLeft = 192;   // columns of `left` at a time, whose rows fit into the cache
  const bool is_same = &left == &right;
  const int panels = (right.columns + linalg::kPanel - 1) / linalg::kPanel;
  Eigen::MatrixXf result = Eigen::MatrixXf::Zero(left.columns, right.columns);
  const linalg::GemmKernels& kernels = linalg::gemm_kernels();
  cv::parallel_for_(cv::Range(0, panels), [&](const cv::Range& range) {
    std::vector<float> part(static_cast<std::size_t>(kLeft) * linalg::kPanel);
    std::vector<float> columns(static_cast<std::size_t>(kBlock) * linalg::kPanel);
    for (int panel = range.start; panel < range.end; ++panel) {
      const int first = panel * linalg::kPanel;
      const int width = std::min(linalg::kPanel, right.columns - first);
      for (int row = begin; row < end; row += kBlock) {
        const int depth = std::min(kBlock, end - row);
        for (int r = 0; r < depth; ++r) {
          const float* from = right.row(row + r) + first;
          float* to = columns.data() + static_cast<std::ptrdiff_t>(r) * linalg::kPanel;
          std::copy(from, from + width, to);
          std::fill(to + width, to + linalg::kPanel, 0.F);
        }
        // A symmetric product needs only the columns up to the end of the panel.
        const int last = is_same ? std::min(left.columns, first + linalg::kPanel) : left.columns;
        for (int column = 0; column < last; column += kLeft) {
          const int count = std::min(kLeft, last - column);
          kernels.panel(count, depth, left.row(row) + column, 1, left.columns, columns.data(),
                        linalg::kPanel, part.data());
          for (int m = 0; m < count; ++m) {
            const float* from = part.data() + static_cast<std::ptrdiff_t>(m) * linalg::kPanel;
            for (int n = 0; n < width; ++n) result(column + m, first + n) += from[n];
          }
        }
      }
    }
  });
  if (is_same) {
    for (int c = 0; c < result.cols(); ++c) {
      for (int r = 0; r < c; ++r) result(c, r) = result(r, c);
    }
  }
  return result;
}

Eigen::MatrixXf ridge(Eigen::MatrixXf squares, const Eigen::MatrixXf& products, float lambda) {
  TARSIER_REQUIRE(squares.rows() == squares.cols() && squares.rows() == products.rows(),
                  "{} x {} and {} rows", squares.rows(), squares.cols(), products.rows());
  const Eigen::Index last = squares.rows() - 1;
  for (Eigen::Index i = 0; i < last; ++i) squares(i, i) += lambda;
  squares(last, last) += 1e-6F * (squares(last, last) + 1);
  Eigen::MatrixXf weights = products;
  if (!linalg::solve_positive_definite(squares, weights))
    throw std::invalid_argument("the regression has no solution: raise its regularisation");
  return weights;
}

}  // namespace tarsier::face::regression
