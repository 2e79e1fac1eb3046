// SPDX-License-Identifier: MIT
#include "tarsier/linalg/tile_cholesky.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"
#include "tarsier/linalg/tile_kernels.h"

#include <Eigen/Cholesky>
#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

namespace tarsier::linalg {
namespace {

// A variable with more than this multiple of the usual number of neighbours is a hub; the value
// with fewer operations is used.
constexpr std::array<std::size_t, 2> kHubDegreeFactors{4, 2};

// min products for each thread that computes a column
constexpr double kMinProductsPerThread = 200;

using Eigen::Index;
using Eigen::SparseMatrix;
using Eigen::VectorXd;

// A minimum-degree elimination order of variables that are linked by blocks.
std::vector<int> minimum_degree_order(int variables,
                                      const std::vector<BlockPattern::Block>& blocks) {
  std::vector<Eigen::Triplet<double>> links;
  links.reserve(2 * blocks.size());
  for (const auto& [row, column] : blocks) {
    links.emplace_back(row, column, 1.0);
    links.emplace_back(column, row, 1.0);
  }
  SparseMatrix<double> graph(variables, variables);
  graph.setFromTriplets(links.begin(), links.end());
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> order;
  Eigen::AMDOrdering<int>()(graph, order);
  return {order.indices().begin(), order.indices().end()};
}

// For each variable: the others with which it shares a block.
std::vector<std::vector<int>> neighbours_of(const BlockPattern& pattern) {
  std::vector<std::vector<int>> neighbours(at(pattern.variables()));
  for (const auto& [row, column] : pattern.blocks) {
    if (row == column) continue;
    neighbours[at(row)].push_back(column);
    neighbours[at(column)].push_back(row);
  }
  return neighbours;
}

// The variables reachable from `start` in breadth-first order, without those already `seen`. The
// last one is far from `start`.
std::vector<int> breadth_first(const std::vector<std::vector<int>>& neighbours, int start,
                               std::vector<char>& seen) {
  std::vector<int> order{start};
  seen[at(start)] = 1;
  std::vector<int> next;
  for (std::size_t k = 0; k < order.size(); ++k) {
    next.clear();
    for (const int other : neighbours[at(order[k])]) {
      if (seen[at(other)] != 0) continue;
      seen[at(other)] = 1;
      next.push_back(other);
    }
    std::stable_sort(next.begin(), next.end(), [&](int one, int other) {
      return neighbours[at(one)].size() < neighbours[at(other)].size();
    });
    order.insert(order.end(), next.begin(), next.end());
  }
  return order;
}

struct Order {
  std::vector<int> variables;
  std::vector<int> hubs;  // placed last
};

// The reverse Cuthill-McKee order. Variables with blocks to nearly all others, like a lens, are
// hubs: they would make all others neighbours.
Order cuthill_mckee_order(const std::vector<std::vector<int>>& neighbours,
                          std::size_t degree_factor) {
  std::vector<std::size_t> degrees;
  degrees.reserve(neighbours.size());
  for (const std::vector<int>& adjacent : neighbours) degrees.push_back(adjacent.size());
  const auto median = degrees.begin() + static_cast<std::ptrdiff_t>(degrees.size() / 2);
  std::nth_element(degrees.begin(), median, degrees.end());
  std::vector<char> done(neighbours.size(), 0);
  std::vector<int> last;
  for (std::size_t i = 0; i < neighbours.size(); ++i) {
    if (neighbours[i].size() <= degree_factor * *median) continue;
    done[i] = 1;
    last.push_back(static_cast<int>(i));
  }
  std::vector<int> order;
  std::vector<char> seen = done;
  for (std::size_t start = 0; start < neighbours.size(); ++start) {
    if (done[start] != 0) continue;
    const int end = breadth_first(neighbours, static_cast<int>(start), seen).back();
    const std::vector<int> part = breadth_first(neighbours, end, done);
    order.insert(order.end(), part.begin(), part.end());
  }
  std::reverse(order.begin(), order.end());
  return {std::move(order), std::move(last)};
}

}  // namespace

void TileCholesky::analyze(BlockPattern pattern) {
  pattern_ = std::move(pattern);
  TARSIER_REQUIRE(!pattern_.first.empty(), "a pattern without an end");
  const std::vector<std::vector<int>> neighbours = neighbours_of(pattern_);
  std::vector<int> best;
  double min_operations = 0;
  bool is_last = false;  // whether `best` was analysed last
  const auto try_order = [&](std::vector<int> variables, const std::vector<int>& hubs) {
    variables.insert(variables.end(), hubs.begin(), hubs.end());
    analyze_in_order(variables);
    is_last = best.empty() || operations() < min_operations;
    if (!is_last) return;
    min_operations = operations();
    best = std::move(variables);
  };
  std::size_t hubs = 0;
  for (const std::size_t degree_factor : kHubDegreeFactors) {
    const Order narrow = cuthill_mckee_order(neighbours, degree_factor);
    if (degree_factor != kHubDegreeFactors.front() && narrow.hubs.size() == hubs) continue;
    hubs = narrow.hubs.size();
    try_order(narrow.variables, narrow.hubs);
  }
  try_order(minimum_degree_order(pattern_.variables(), pattern_.blocks), {});
  if (!is_last) analyze_in_order(best);
  list_products();
  locate_blocks();
}

void TileCholesky::analyze_in_order(const std::vector<int>& variables) {
  order_tiles(variables);
  std::vector<std::vector<int>> below(columns_.size());
  for (const auto& [row, column] : pattern_.blocks) {
    for (int r = pattern_.first_of(row); r < pattern_.first_of(row + 1); ++r) {
      for (int c = pattern_.first_of(column); c < pattern_.first_of(column + 1); ++c) {
        const int first = std::min(position_[at(r)], position_[at(c)]) / kTileSize;
        const int second = std::max(position_[at(r)], position_[at(c)]) / kTileSize;
        if (first != second && (below[at(first)].empty() || below[at(first)].back() != second))
          below[at(first)].push_back(second);
      }
    }
  }
  factorize_symbolically(std::move(below));
}

// Cuts the rows into tiles and sorts the tiles into the elimination order.
void TileCholesky::order_tiles(const std::vector<int>& variables) {
  const int size = pattern_.size();
  std::vector<int> order;  // of rows
  for (const int variable : variables)
    for (int k = pattern_.first_of(variable); k < pattern_.first_of(variable + 1); ++k)
      order.push_back(k);
  std::vector<int> position(order.size());
  for (int k = 0; k < size; ++k) position[at(order[at(k)])] = k;
  const int tiles = (size + kTileSize - 1) / kTileSize;
  std::vector<BlockPattern::Block> links;  // of tiles
  for (const auto& [row, column] : pattern_.blocks) {
    // The rows of a variable are consecutive.
    const int rows[] = {position[at(pattern_.first_of(row))] / kTileSize,
                        position[at(pattern_.first_of(row + 1) - 1)] / kTileSize};
    const int columns[] = {position[at(pattern_.first_of(column))] / kTileSize,
                           position[at(pattern_.first_of(column + 1) - 1)] / kTileSize};
    for (int r = rows[0]; r <= rows[1]; ++r)
      for (int c = columns[0]; c <= columns[1]; ++c) links.push_back({r, c});
  }
  const std::vector<int> elimination = minimum_degree_order(tiles, links);
  columns_.assign(at(tiles), {});
  padded_ = {};
  position_.assign(at(size), 0);
  for (int t = 0; t < tiles; ++t) {
    const int first = elimination[at(t)] * kTileSize;
    for (int k = first; k < std::min(first + kTileSize, size); ++k)
      position_[at(order[at(k)])] = t * kTileSize + k - first;
    if (first + kTileSize > size) padded_ = {t, size - first};
  }
}

// The nonzero tiles of L: all tiles below a column's first one also appear in the column of that
// tile.
void TileCholesky::factorize_symbolically(std::vector<std::vector<int>> below) {
  for (std::size_t t = 0; t < columns_.size(); ++t) {
    std::vector<int>& tiles = below[t];
    std::sort(tiles.begin(), tiles.end());
    tiles.erase(std::unique(tiles.begin(), tiles.end()), tiles.end());
    if (tiles.empty()) continue;
    std::vector<int>& parent = below[at(tiles.front())];
    parent.insert(parent.end(), tiles.begin() + 1, tiles.end());
  }
  tile_count_ = 0;
  for (std::size_t t = 0; t < columns_.size(); ++t) {
    columns_[t].below = std::move(below[t]);
    columns_[t].first = tile_count_;
    tile_count_ += 1 + static_cast<int>(columns_[t].below.size());
    for (const int tile : columns_[t].below) columns_[at(tile)].from.push_back(static_cast<int>(t));
  }
}

// Finds the tiles of earlier columns that contribute to each tile.
void TileCholesky::list_products() {
  products_.clear();
  first_product_.assign(1, 0);
  const auto list = [&](int row, int column) {
    for (const int source : columns_[at(column)].from) {
      const int left = tile_at(row, source);
      if (left >= 0) products_.push_back({left, tile_at(column, source)});
    }
    first_product_.push_back(products_.size());
  };
  for (int column = 0; column < static_cast<int>(columns_.size()); ++column) {
    list(column, column);
    for (const int row : columns_[at(column)].below) list(row, column);
  }
}

double TileCholesky::operations() const {
  double sum = 0;
  for (const Column& column : columns_) {
    const double rows = kTileSize * (1.0 + static_cast<double>(column.below.size()));
    sum += kTileSize * rows * rows / 2;
  }
  return sum;
}

double TileCholesky::solve_operations() const {
  return 2.0 * static_cast<double>(tile_count_) * static_cast<double>(kTileElements);
}

int TileCholesky::tile_at(int row, int column) const {
  const Column& of = columns_[at(column)];
  if (row == column) return of.first;
  const auto found = std::lower_bound(of.below.begin(), of.below.end(), row);
  if (found == of.below.end() || *found != row) return -1;
  return of.first + 1 + static_cast<int>(found - of.below.begin());
}

// Finds the tile of each block; -1 if it lies in several.
void TileCholesky::locate_blocks() {
  const auto tile_of = [&](int variable) {
    const int first = position_[at(pattern_.first_of(variable))] / kTileSize;
    const int last = position_[at(pattern_.first_of(variable + 1) - 1)] / kTileSize;
    return first == last ? first : -1;
  };
  tile_of_block_.clear();
  for (const auto& [row, column] : pattern_.blocks) {
    const int one = tile_of(row);
    const int other = tile_of(column);
    tile_of_block_.push_back(
        one < 0 || other < 0 ? -1 : tile_at(std::max(one, other), std::min(one, other)));
  }
}

void TileCholesky::fill(const double* values) {
  tiles_.create(tile_count_, static_cast<int>(kTileElements), CV_64F);
  tiles_.setTo(0);
  for (std::size_t b = 0; b < pattern_.blocks.size(); ++b) {
    const auto& [row, column] = pattern_.blocks[b];
    const int rows = pattern_.size_of(row);
    const int first_row = position_[at(pattern_.first_of(row))];
    const int first_column = position_[at(pattern_.first_of(column))];
    double* const tile = tile_of_block_[b] < 0 ? nullptr : numbers(tile_of_block_[b]);
    for (int c = 0; c < pattern_.size_of(column); ++c, values += rows) {
      const int limit = row == column ? c + 1 : rows;
      if (tile == nullptr) {
        for (int r = 0; r < limit; ++r)
          element(position_[at(pattern_.first_of(row) + r)],
                  position_[at(pattern_.first_of(column) + c)]) = values[r];
      } else if (first_row > first_column) {
        for (int r = 0; r < limit; ++r)
          tile[in_tile((first_row + r) % kTileSize, (first_column + c) % kTileSize)] = values[r];
      } else {
        for (int r = 0; r < limit; ++r)
          tile[in_tile((first_column + c) % kTileSize, (first_row + r) % kTileSize)] = values[r];
      }
    }
  }
  for (int k = padded_.size; k < kTileSize; ++k)
    numbers(columns_[at(padded_.tile)].first)[in_tile(k, k)] = 1;
}

double& TileCholesky::element(int one, int other) {
  const auto [column, row] = std::minmax(one, other);
  return numbers(
      tile_at(row / kTileSize, column / kTileSize))[in_tile(row % kTileSize, column % kTileSize)];
}

void TileCholesky::subtract_products(int tile) {
  const TileKernels& kernels = tile_kernels();
  for (std::size_t k = first_product_[at(tile)]; k < first_product_[at(tile) + 1]; ++k)
    kernels.subtract_product(numbers(products_[k].left), numbers(products_[k].right),
                             numbers(tile));
}

bool TileCholesky::factorize_diagonal(double* tile) {
  Eigen::Matrix<double, kTileSize, kTileSize> a;
  for (int c = 0; c < kTileSize; ++c)
    for (int r = c; r < kTileSize; ++r) a(r, c) = tile[in_tile(r, c)];
  const Eigen::LLT<Eigen::Ref<decltype(a)>> factor(a);
  if (factor.info() != Eigen::Success) return false;
  for (int c = 0; c < kTileSize; ++c)
    for (int r = 0; r < kTileSize; ++r) tile[in_tile(r, c)] = r < c ? 0 : a(r, c);
  return true;
}

bool TileCholesky::factorize(const double* values) {
  fill(values);
  const TileKernels& kernels = tile_kernels();
  for (const Column& column : columns_) {
    double* diagonal = numbers(column.first);
    subtract_products(column.first);
    if (!factorize_diagonal(diagonal)) return false;
    const int begin = column.first + 1;
    const int end = begin + static_cast<int>(column.below.size());
    const auto products = static_cast<double>(first_product_[at(end)] - first_product_[at(begin)]);
    cv::parallel_for_(
        cv::Range(begin, end),
        [&](const cv::Range& range) {
          for (int tile = range.start; tile < range.end; ++tile) {
            subtract_products(tile);
            kernels.solve_triangular(diagonal, numbers(tile));
          }
        },
        std::max(1.0, products / kMinProductsPerThread));
  }
  return true;
}

VectorXd TileCholesky::solve(const VectorXd& b) const {
  using Segment = Eigen::Matrix<double, kTileSize, 1>;
  using Strip = Eigen::Map<const Eigen::Matrix<double, kStrip, kTileSize>>;
  VectorXd x = VectorXd::Zero(static_cast<Index>(columns_.size()) * kTileSize);
  for (Index i = 0; i < b.size(); ++i) x[position_[static_cast<std::size_t>(i)]] = b[i];
  for (std::size_t t = 0; t < columns_.size(); ++t) {
    const Column& column = columns_[t];
    auto own = x.segment<kTileSize>(static_cast<Index>(t) * kTileSize);
    const double* diagonal = numbers(column.first);
    for (int c = 0; c < kTileSize; ++c) {
      own[c] /= diagonal[in_tile(c, c)];
      for (int r = c + 1; r < kTileSize; ++r) own[r] -= diagonal[in_tile(r, c)] * own[c];
    }
    const Segment solved = own;
    for (std::size_t k = 0; k < column.below.size(); ++k) {
      const double* tile = numbers(column.first + 1 + static_cast<int>(k));
      double* below = x.data() + std::ptrdiff_t{column.below[k]} * kTileSize;
      for (int r = 0; r < kTileSize; r += kStrip)
        Eigen::Map<Eigen::Matrix<double, kStrip, 1>>(below + r).noalias() -=
            Strip(tile + in_tile(r, 0)) * solved;
    }
  }
  for (std::size_t t = columns_.size(); t-- > 0;) {
    const Column& column = columns_[t];
    Segment own = x.segment<kTileSize>(static_cast<Index>(t) * kTileSize);
    for (std::size_t k = 0; k < column.below.size(); ++k) {
      const double* tile = numbers(column.first + 1 + static_cast<int>(k));
      const double* below = x.data() + std::ptrdiff_t{column.below[k]} * kTileSize;
      for (int r = 0; r < kTileSize; r += kStrip)
        own.noalias() -= Strip(tile + in_tile(r, 0)).transpose() *
                         Eigen::Map<const Eigen::Matrix<double, kStrip, 1>>(below + r);
    }
    const double* diagonal = numbers(column.first);
    for (int c = kTileSize - 1; c >= 0; --c) {
      for (int r = c + 1; r < kTileSize; ++r) own[c] -= diagonal[in_tile(r, c)] * own[r];
      own[c] /= diagonal[in_tile(c, c)];
    }
    x.segment<kTileSize>(static_cast<Index>(t) * kTileSize) = own;
  }
  VectorXd result(b.size());
  for (Index i = 0; i < b.size(); ++i) result[i] = x[position_[static_cast<std::size_t>(i)]];
  return result;
}

}  // namespace tarsier::linalg
