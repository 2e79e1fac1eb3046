// SPDX-License-Identifier: MIT
#include "tarsier/linalg/sparse_cholesky.h"

#include "tarsier/core/require.h"

#include <Eigen/SparseCholesky>

#include <algorithm>
#include <optional>
#include <utility>

namespace tarsier::linalg {
namespace {

constexpr double kMinTileOperations = 1e7;  // with fewer, tiles are not considered
constexpr double kTileSpeedup = 6;  // tile operations that take the time of one element operation
// Solutions per factorization, in operations, from which it is costly.
constexpr double kMinCostlySolutions = 200;

// Each element of the upper triangle is a block.
BlockPattern pattern_of(const Eigen::SparseMatrix<double>& a) {
  BlockPattern pattern;
  for (int c = 0; c < a.outerSize(); ++c) {
    pattern.first.push_back(c);
    for (Eigen::SparseMatrix<double>::InnerIterator element(a, c); element; ++element)
      if (element.row() <= c) pattern.blocks.push_back({static_cast<int>(element.row()), c});
  }
  pattern.first.push_back(static_cast<int>(a.cols()));
  return pattern;
}

// A sparse matrix with one element per block.
Eigen::SparseMatrix<double> graph_of(const BlockPattern& pattern) {
  Eigen::SparseMatrix<double> graph(pattern.variables(), pattern.variables());
  graph.reserve(static_cast<Eigen::Index>(pattern.blocks.size()));
  std::size_t next = 0;
  for (int column = 0; column < pattern.variables(); ++column) {
    graph.startVec(column);
    for (; next < pattern.blocks.size() && pattern.blocks[next].column == column; ++next)
      graph.insertBack(pattern.blocks[next].row, column) = 1;
  }
  graph.finalize();
  return graph;
}

// A x for the matrix of the blocks, of which only the upper triangle is read.
Eigen::VectorXd product_of(const BlockPattern& pattern, const double* values,
                           const Eigen::VectorXd& x) {
  Eigen::VectorXd result = Eigen::VectorXd::Zero(x.size());
  for (const auto& [row, column] : pattern.blocks) {
    const Eigen::Index r = pattern.first_of(row);
    const Eigen::Index c = pattern.first_of(column);
    const Eigen::Map<const Eigen::MatrixXd> block(values, pattern.size_of(row),
                                                  pattern.size_of(column));
    values += block.size();
    const auto right = x.segment(c, block.cols());
    auto to = result.segment(r, block.rows());
    if (row == column) {
      to.noalias() += block.selfadjointView<Eigen::Upper>() * right;
      continue;
    }
    to.noalias() += block.lazyProduct(right);
    result.segment(c, block.cols()).noalias() +=
        block.transpose().lazyProduct(x.segment(r, block.rows()));
  }
  return result;
}

}  // namespace

// Uses elements or tiles; the other one is empty.
struct SparseCholesky::Factor {
  class ElementCholesky : public Eigen::SimplicialLLT<Eigen::SparseMatrix<double>, Eigen::Upper> {
   public:
    // Multiplications of a factorization if each element is a block of `block` rows and columns.
    [[nodiscard]] double operations(double block = 1) const {
      return block * (block * m_nonZerosPerCol.cast<double>()).squaredNorm() / 2;
    }
  };

  std::optional<ElementCholesky> elements;
  std::optional<TileCholesky> tiles;
  BlockPattern pattern;                // if it was given
  Eigen::SparseMatrix<double> matrix;  // likewise; the upper triangle

  // Whether tiles are faster than `operations` operations on elements.
  bool try_tiles(double operations, BlockPattern given) {
    tiles.emplace();
    tiles->analyze(std::move(given));
    if (tiles->operations() < kTileSpeedup * operations) return true;
    tiles.reset();
    return false;
  }

  // The matrix of the blocks, stored column by column.
  void fill(const std::vector<double>& values) {
    const bool is_first = matrix.nonZeros() == 0;
    if (is_first) {
      matrix.resize(pattern.size(), pattern.size());
      matrix.reserve(static_cast<Eigen::Index>(values.size()));
    }
    Eigen::Index filled = 0;
    const double* begin_of_column = values.data();
    std::size_t begin = 0;
    for (int v = 0; v < pattern.variables(); ++v) {
      const int columns = pattern.size_of(v);
      std::size_t end = begin;
      while (end < pattern.blocks.size() && pattern.blocks[end].column == v) ++end;
      for (int c = 0; c < columns; ++c) {
        if (is_first) matrix.startVec(pattern.first_of(v) + c);
        const double* numbers = begin_of_column;
        for (std::size_t b = begin; b < end; ++b) {
          const int row = pattern.blocks[b].row;
          const int rows = pattern.size_of(row);
          for (int r = 0; r < (row == v ? c + 1 : rows); ++r) {
            if (is_first) matrix.insertBack(pattern.first_of(row) + r, pattern.first_of(v) + c) = 1;
            matrix.valuePtr()[filled++] = numbers[c * rows + r];
          }
          numbers += rows * columns;
        }
        if (c + 1 == columns) begin_of_column = numbers;
      }
      begin = end;
    }
    if (is_first) matrix.finalize();
  }
};

SparseCholesky::SparseCholesky() : factor_(std::make_unique<Factor>()) {}
SparseCholesky::~SparseCholesky() = default;
SparseCholesky::SparseCholesky(SparseCholesky&&) noexcept = default;
SparseCholesky& SparseCholesky::operator=(SparseCholesky&&) noexcept = default;

void SparseCholesky::analyze(const Eigen::SparseMatrix<double>& a) {
  TARSIER_REQUIRE(a.rows() == a.cols(), "a {} x {} matrix", a.rows(), a.cols());
  factor_ = std::make_unique<Factor>();
  factor_->elements.emplace();
  factor_->elements->analyzePattern(a);
  const double operations = factor_->elements->operations();
  if (operations < kMinTileOperations) return;
  if (factor_->try_tiles(operations, pattern_of(a))) factor_->elements.reset();
}

void SparseCholesky::analyze(const BlockPattern& pattern) {
  factor_ = std::make_unique<Factor>();
  factor_->pattern = pattern;
  Factor::ElementCholesky blocks;
  blocks.analyzePattern(graph_of(pattern));
  const double operations =
      blocks.operations(static_cast<double>(pattern.size()) / std::max(1, pattern.variables()));
  if (operations >= kMinTileOperations) (void)factor_->try_tiles(operations, pattern);
}

bool SparseCholesky::factorize(const Eigen::SparseMatrix<double>& a) {
  if (factor_->tiles) {
    std::vector<double> values;
    values.reserve(static_cast<std::size_t>(a.nonZeros()));
    for (int c = 0; c < a.outerSize(); ++c)
      for (Eigen::SparseMatrix<double>::InnerIterator element(a, c); element; ++element)
        if (element.row() <= c) values.push_back(element.value());
    return factor_->tiles->factorize(values.data());
  }
  factor_->elements->factorize(a);
  return factor_->elements->info() == Eigen::Success;
}

bool SparseCholesky::factorize(const std::vector<double>& values) {
  if (factor_->tiles) return factor_->tiles->factorize(values.data());
  factor_->fill(values);
  if (!factor_->elements) {
    factor_->elements.emplace();
    factor_->elements->analyzePattern(factor_->matrix);
  }
  factor_->elements->factorize(factor_->matrix);
  return factor_->elements->info() == Eigen::Success;
}

Eigen::VectorXd SparseCholesky::solve(const Eigen::VectorXd& b) const {
  return factor_->tiles ? factor_->tiles->solve(b) : factor_->elements->solve(b).eval();
}

bool SparseCholesky::is_costly() const {
  return factor_->tiles &&
         factor_->tiles->operations() >= kMinCostlySolutions * factor_->tiles->solve_operations();
}

std::optional<Eigen::VectorXd> SparseCholesky::solve_near(const std::vector<double>& values,
                                                          const Eigen::VectorXd& b,
                                                          double tolerance,
                                                          int max_iterations) const {
  Eigen::VectorXd x = Eigen::VectorXd::Zero(b.size());
  Eigen::VectorXd residual = b;
  Eigen::VectorXd preconditioned = solve(residual);
  Eigen::VectorXd direction = preconditioned;
  double size = residual.dot(preconditioned);
  const double limit = tolerance * tolerance * size;
  for (int k = 0; k < max_iterations; ++k) {
    if (size <= limit) return x;
    const Eigen::VectorXd product = product_of(factor_->pattern, values.data(), direction);
    const double curvature = direction.dot(product);
    if (!(curvature > 0)) return std::nullopt;
    x += size / curvature * direction;
    residual -= size / curvature * product;
    preconditioned = solve(residual);
    const double before = std::exchange(size, residual.dot(preconditioned));
    direction = preconditioned + size / before * direction;
  }
  return size <= limit ? std::optional(std::move(x)) : std::nullopt;
}

}  // namespace tarsier::linalg
