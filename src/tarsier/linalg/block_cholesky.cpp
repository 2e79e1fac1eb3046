// SPDX-License-Identifier: MIT
#include "tarsier/linalg/block_cholesky.h"

#include "tarsier/core/require.h"
#include "tarsier/linalg/gemm.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <vector>

namespace tarsier::linalg {
namespace {

using RowMajor = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
constexpr Eigen::Index kRows = 192;  // rows per product, so that they stay in the cache

// target (rows x width, at `to` of a column-major matrix of `stride` rows) -= the kernel's product.
void subtract(const std::vector<float>& product, Eigen::Index rows, Eigen::Index width, float* to,
              Eigen::Index stride) {
  for (Eigen::Index c = 0; c < width; ++c)
    for (Eigen::Index r = 0; r < rows; ++r)
      to[c * stride + r] -= product[static_cast<std::size_t>(r * kPanel + c)];
}

bool factor(Eigen::MatrixXf& a) {
  const Eigen::Index n = a.rows();
  const GemmKernels& kernels = gemm_kernels();
  std::vector<float> product(static_cast<std::size_t>(kRows * kPanel));
  std::vector<float> left(static_cast<std::size_t>(n * kPanel), 0.F);
  for (Eigen::Index first = 0; first < n; first += kPanel) {
    const Eigen::Index width = std::min<Eigen::Index>(kPanel, n - first);
    for (Eigen::Index k = 0; k < first; ++k) {
      float* row = left.data() + k * kPanel;
      std::copy_n(a.data() + k * n + first, width, row);
      std::fill(row + width, row + kPanel, 0.F);
    }
    if (first > 0) {
      for (Eigen::Index r = first; r < n; r += kRows) {
        const Eigen::Index rows = std::min(kRows, n - r);
        kernels.panel(static_cast<int>(rows), static_cast<int>(first), a.data() + r, 1, n,
                      left.data(), kPanel, product.data());
        subtract(product, rows, width, a.data() + first * n + r, n);
      }
    }
    auto corner = a.block(first, first, width, width);
    const Eigen::LLT<Eigen::MatrixXf> small(corner);
    if (small.info() != Eigen::Success) return false;
    corner.triangularView<Eigen::Lower>() = small.matrixL();
    const Eigen::Index below = n - first - width;
    if (below > 0) {
      auto rest = a.block(first + width, first, below, width);
      small.matrixU().solveInPlace<Eigen::OnTheRight>(rest);
    }
  }
  return true;
}

}  // namespace

bool solve_positive_definite(Eigen::MatrixXf& a, Eigen::MatrixXf& b) {
  TARSIER_REQUIRE(a.rows() == a.cols() && a.rows() == b.rows(), "{} x {} and {} rows", a.rows(),
                  a.cols(), b.rows());
  if (!factor(a)) return false;
  const Eigen::Index n = a.rows();
  const Eigen::Index padded = (b.cols() + kPanel - 1) / kPanel * kPanel;
  RowMajor x = RowMajor::Zero(n, padded);
  x.leftCols(b.cols()) = b;
  const GemmKernels& kernels = gemm_kernels();
  std::vector<float> product(static_cast<std::size_t>(kPanel * kPanel));
  // x(first.., panel) -= factor (width x depth) * x(from.., panel)
  const auto reduce = [&](Eigen::Index first, Eigen::Index width, const float* factor,
                          Eigen::Index row, Eigen::Index column, Eigen::Index from,
                          Eigen::Index depth) {
    if (depth == 0) return;
    for (Eigen::Index panel = 0; panel < padded; panel += kPanel) {
      kernels.panel(static_cast<int>(width), static_cast<int>(depth), factor, row, column,
                    x.data() + from * padded + panel, padded, product.data());
      for (Eigen::Index r = 0; r < width; ++r)
        for (Eigen::Index c = 0; c < kPanel; ++c)
          x(first + r, panel + c) -= product[static_cast<std::size_t>(r * kPanel + c)];
    }
  };
  for (Eigen::Index first = 0; first < n; first += kPanel) {
    const Eigen::Index width = std::min<Eigen::Index>(kPanel, n - first);
    reduce(first, width, a.data() + first, 1, n, 0, first);
    auto rows = x.middleRows(first, width);
    a.block(first, first, width, width).triangularView<Eigen::Lower>().solveInPlace(rows);
  }
  for (Eigen::Index first = (n - 1) / kPanel * kPanel; first >= 0; first -= kPanel) {
    const Eigen::Index width = std::min<Eigen::Index>(kPanel, n - first);
    const Eigen::Index next = first + width;
    reduce(first, width, a.data() + first * n + next, n, 1, next, n - next);
    auto rows = x.middleRows(first, width);
    a.block(first, first, width, width)
        .triangularView<Eigen::Lower>()
        .transpose()
        .solveInPlace(rows);
  }
  b = x.leftCols(b.cols());
  return true;
}

}  // namespace tarsier::linalg
