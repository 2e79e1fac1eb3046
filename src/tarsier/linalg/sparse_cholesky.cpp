// SPDX-License-Identifier: MIT
#include "tarsier/linalg/sparse_cholesky.h"

#include "tarsier/core/require.h"
#include "tarsier/linalg/tile_cholesky.h"

#include <Eigen/SparseCholesky>

#include <optional>

namespace tarsier::linalg {
namespace {

constexpr double kManyOperations = 1e8;  // below, tiles are not looked for
constexpr double kTileGain = 4;          // operations of tiles in the time of one of elements

class ByElements : public Eigen::SimplicialLLT<Eigen::SparseMatrix<double>, Eigen::Upper> {
 public:
  // Multiplications of a factorization.
  [[nodiscard]] double operations() const {
    return m_nonZerosPerCol.cast<double>().squaredNorm() / 2;
  }
};

}  // namespace

// One of the two; the other takes no memory.
struct SparseCholesky::Factor {
  std::optional<ByElements> elements;
  std::optional<TileCholesky> tiles;
};

SparseCholesky::SparseCholesky() : factor_(std::make_unique<Factor>()) {}
SparseCholesky::~SparseCholesky() = default;
SparseCholesky::SparseCholesky(SparseCholesky&&) noexcept = default;
SparseCholesky& SparseCholesky::operator=(SparseCholesky&&) noexcept = default;

void SparseCholesky::analyze(const Eigen::SparseMatrix<double>& a) {
  TARSIER_REQUIRE(a.rows() == a.cols(), "a {} x {} matrix", a.rows(), a.cols());
  factor_->tiles.reset();
  factor_->elements.emplace();
  factor_->elements->analyzePattern(a);
  const double operations = factor_->elements->operations();
  if (operations < kManyOperations) return;
  factor_->tiles.emplace();
  factor_->tiles->analyze(a);
  if (factor_->tiles->operations() < kTileGain * operations) {
    factor_->elements.reset();
  } else {
    factor_->tiles.reset();
  }
}

bool SparseCholesky::factorize(const Eigen::SparseMatrix<double>& a) {
  if (factor_->tiles) return factor_->tiles->factorize(a);
  factor_->elements->factorize(a);
  return factor_->elements->info() == Eigen::Success;
}

Eigen::VectorXd SparseCholesky::solve(const Eigen::VectorXd& b) const {
  return factor_->tiles ? factor_->tiles->solve(b) : factor_->elements->solve(b).eval();
}

}  // namespace tarsier::linalg
