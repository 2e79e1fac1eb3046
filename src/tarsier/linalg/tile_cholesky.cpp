// SPDX-License-Identifier: MIT
#include "tarsier/linalg/tile_cholesky.h"

#include "tarsier/core/require.h"

#include <Eigen/Cholesky>
#include <Eigen/OrderingMethods>

#include <algorithm>
#include <cstddef>
#include <utility>

namespace tarsier::linalg {
namespace {

constexpr int kTile = 48;              // variables: eight cameras
constexpr std::size_t kManyTimes = 4;  // as many neighbours as most variables have

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::SparseMatrix;
using Eigen::VectorXd;

std::size_t at(int i) { return static_cast<std::size_t>(i); }

// Of each variable the others that it shares a nonzero element with.
std::vector<std::vector<int>> neighbours_of(const SparseMatrix<double>& a) {
  std::vector<std::vector<int>> neighbours(static_cast<std::size_t>(a.cols()));
  for (int c = 0; c < a.outerSize(); ++c) {
    for (SparseMatrix<double>::InnerIterator element(a, c); element; ++element) {
      const auto r = static_cast<int>(element.row());
      if (r >= c) continue;
      neighbours[at(r)].push_back(c);
      neighbours[at(c)].push_back(r);
    }
  }
  return neighbours;
}

// The variables from `start` on, those that are next to each other one after the other; those that are `seen` are left out.
// The last one is far from `start`.
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

// The order of Cuthill and McKee, reversed; then the variables that nearly all are tied to, as a lens is: they would make
// neighbours of all others.
std::vector<int> narrow_order(const std::vector<std::vector<int>>& neighbours) {
  std::vector<std::size_t> degrees;
  for (const std::vector<int>& of_one : neighbours) degrees.push_back(of_one.size());
  const auto middle = degrees.begin() + static_cast<std::ptrdiff_t>(degrees.size() / 2);
  std::nth_element(degrees.begin(), middle, degrees.end());
  std::vector<char> done(neighbours.size(), 0);
  std::vector<int> last;
  for (std::size_t i = 0; i < neighbours.size(); ++i) {
    if (neighbours[i].size() <= kManyTimes * *middle) continue;
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
  order.insert(order.end(), last.begin(), last.end());
  return order;
}

}  // namespace

void TileCholesky::analyze(const SparseMatrix<double>& a) {
  TARSIER_REQUIRE(a.rows() == a.cols(), "a {} x {} matrix", a.rows(), a.cols());
  order_tiles(a);
  std::vector<std::vector<int>> below(columns_.size());
  for (int c = 0; c < a.outerSize(); ++c) {
    for (SparseMatrix<double>::InnerIterator element(a, c); element; ++element) {
      if (element.row() > c) continue;
      const auto [first, second] = std::minmax(
          tile_[at(place_[at(static_cast<int>(element.row()))])], tile_[at(place_[at(c)])]);
      if (first != second) below[at(first)].push_back(second);
    }
  }
  find_fill(std::move(below));
}

// Cuts the variables into tiles, and puts these into the order of elimination.
void TileCholesky::order_tiles(const SparseMatrix<double>& a) {
  const auto size = static_cast<int>(a.cols());
  const std::vector<int> order = narrow_order(neighbours_of(a));
  std::vector<int> position(order.size());
  for (int k = 0; k < size; ++k) position[at(order[at(k)])] = k;
  const int tiles = (size + kTile - 1) / kTile;
  std::vector<Eigen::Triplet<double>> linked;
  for (int c = 0; c < a.outerSize(); ++c) {
    int last = -1;
    for (SparseMatrix<double>::InnerIterator element(a, c); element; ++element) {
      const int row = position[at(static_cast<int>(element.row()))] / kTile;
      const int column = position[at(c)] / kTile;
      if (row == last) continue;
      last = row;
      linked.emplace_back(row, column, 1.0);
      linked.emplace_back(column, row, 1.0);
    }
  }
  SparseMatrix<double> graph(tiles, tiles);
  graph.setFromTriplets(linked.begin(), linked.end());
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> elimination;
  Eigen::AMDOrdering<int>()(graph, elimination);
  columns_.assign(at(tiles), {});
  place_.assign(at(size), 0);
  tile_.assign(at(size), 0);
  int place = 0;
  for (int t = 0; t < tiles; ++t) {
    const int first = elimination.indices()[t] * kTile;
    columns_[at(t)].begin = place;
    columns_[at(t)].size = std::min(kTile, size - first);
    for (int k = first; k < std::min(first + kTile, size); ++k) {
      tile_[at(place)] = t;
      place_[at(order[at(k)])] = place++;
    }
  }
}

// The tiles that are not empty in L: what a column has below its first such tile, that one has as well.
void TileCholesky::find_fill(std::vector<std::vector<int>> below) {
  for (std::size_t t = 0; t < columns_.size(); ++t) {
    std::vector<int>& tiles = below[t];
    std::sort(tiles.begin(), tiles.end());
    tiles.erase(std::unique(tiles.begin(), tiles.end()), tiles.end());
    if (tiles.empty()) continue;
    std::vector<int>& parent = below[at(tiles.front())];
    parent.insert(parent.end(), tiles.begin() + 1, tiles.end());
  }
  for (std::size_t t = 0; t < columns_.size(); ++t) {
    Column& column = columns_[t];
    column.below = std::move(below[t]);
    Index rows = column.size;
    for (const int tile : column.below) {
      column.offset.push_back(rows);
      rows += columns_[at(tile)].size;
      columns_[at(tile)].from.push_back(static_cast<int>(t));
    }
    column.offset.push_back(rows);
  }
}

double TileCholesky::operations() const {
  double sum = 0;
  for (const Column& column : columns_) {
    const auto size = static_cast<double>(column.size);
    const auto rows = static_cast<double>(column.offset.back());
    sum += size * rows * rows / 2;
  }
  return sum;
}

Index TileCholesky::row_of(const Column& column, int self, int tile) {
  if (tile == self) return 0;
  const auto found = std::lower_bound(column.below.begin(), column.below.end(), tile);
  return column.offset[static_cast<std::size_t>(found - column.below.begin())];
}

// Takes what an earlier column says of it from a column.
void TileCholesky::update(int target, int source, MatrixXd& product) {
  const Column& from = columns_[at(source)];
  Column& to = columns_[at(target)];
  const auto first = static_cast<std::size_t>(
      std::lower_bound(from.below.begin(), from.below.end(), target) - from.below.begin());
  const Index begin = from.offset[first];
  const Index rows = from.offset.back() - begin;
  product.resize(rows, to.size);
  product.noalias() =
      from.panel.bottomRows(rows) * from.panel.middleRows(begin, to.size).transpose();
  for (std::size_t k = first; k < from.below.size(); ++k) {
    const Index size = from.offset[k + 1] - from.offset[k];
    to.panel.middleRows(row_of(to, target, from.below[k]), size) -=
        product.middleRows(from.offset[k] - begin, size);
  }
}

bool TileCholesky::factorize(const SparseMatrix<double>& a) {
  for (Column& column : columns_) column.panel.setZero(column.offset.back(), column.size);
  for (int c = 0; c < a.outerSize(); ++c) {
    for (SparseMatrix<double>::InnerIterator element(a, c); element; ++element) {
      if (element.row() > c) continue;
      const auto [first, second] =
          std::minmax(place_[at(static_cast<int>(element.row()))], place_[at(c)]);
      const int tile = tile_[at(second)];
      Column& column = columns_[at(tile_[at(first)])];
      column.panel(row_of(column, tile_[at(first)], tile) + second - columns_[at(tile)].begin,
                   first - column.begin) = element.value();
    }
  }
  MatrixXd product;
  for (std::size_t t = 0; t < columns_.size(); ++t) {
    Column& column = columns_[t];
    for (const int source : column.from) update(static_cast<int>(t), source, product);
    const Eigen::LLT<MatrixXd> diagonal(column.panel.topRows(column.size));
    if (diagonal.info() != Eigen::Success) return false;
    column.panel.topRows(column.size) = diagonal.matrixL();
    const Index rows = column.offset.back() - column.size;
    if (rows > 0) diagonal.matrixU().solveInPlace<Eigen::OnTheRight>(column.panel.bottomRows(rows));
  }
  return true;
}

VectorXd TileCholesky::solve(const VectorXd& b) const {
  VectorXd x(b.size());
  for (Index i = 0; i < b.size(); ++i) x[place_[static_cast<std::size_t>(i)]] = b[i];
  for (const Column& column : columns_) {
    auto own = x.segment(column.begin, column.size);
    column.panel.topRows(column.size).triangularView<Eigen::Lower>().solveInPlace(own);
    for (std::size_t k = 0; k < column.below.size(); ++k) {
      const Column& other = columns_[at(column.below[k])];
      x.segment(other.begin, other.size).noalias() -=
          column.panel.middleRows(column.offset[k], other.size) * own;
    }
  }
  for (auto column = columns_.rbegin(); column != columns_.rend(); ++column) {
    auto own = x.segment(column->begin, column->size);
    for (std::size_t k = 0; k < column->below.size(); ++k) {
      const Column& other = columns_[at(column->below[k])];
      own.noalias() -= column->panel.middleRows(column->offset[k], other.size).transpose() *
                       x.segment(other.begin, other.size);
    }
    column->panel.topRows(column->size)
        .transpose()
        .triangularView<Eigen::Upper>()
        .solveInPlace(own);
  }
  VectorXd result(b.size());
  for (Index i = 0; i < b.size(); ++i) result[i] = x[place_[static_cast<std::size_t>(i)]];
  return result;
}

}  // namespace tarsier::linalg
