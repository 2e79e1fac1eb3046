// SPDX-License-Identifier: MIT
#include "tarsier/linalg/dissection.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <set>
#include <vector>

namespace tarsier::linalg {
namespace {

using Graph = std::vector<std::vector<int>>;

Graph grid(int side) {
  Graph neighbours(static_cast<std::size_t>(side * side));
  const auto connect = [&](int one, int other) {
    neighbours[static_cast<std::size_t>(one)].push_back(other);
    neighbours[static_cast<std::size_t>(other)].push_back(one);
  };
  for (int v = 0; v < side * side; ++v) {
    if (v % side + 1 < side) connect(v, v + 1);
    if (v + side < side * side) connect(v, v + side);
  }
  return neighbours;
}

std::vector<int> all_of(const Graph& neighbours) {
  std::vector<int> all(neighbours.size());
  for (std::size_t v = 0; v < all.size(); ++v) all[v] = static_cast<int>(v);
  return all;
}

// Number of entries of the factor below its diagonal.
std::size_t fill(const Graph& neighbours, const std::vector<int>& order) {
  std::vector<std::size_t> position(neighbours.size());
  for (std::size_t k = 0; k < order.size(); ++k) position[static_cast<std::size_t>(order[k])] = k;
  std::vector<std::set<std::size_t>> below(order.size());
  std::size_t sum = 0;
  for (std::size_t k = 0; k < order.size(); ++k) {
    for (const int other : neighbours[static_cast<std::size_t>(order[k])])
      if (position[static_cast<std::size_t>(other)] > k)
        below[k].insert(position[static_cast<std::size_t>(other)]);
    sum += below[k].size();
    if (!below[k].empty())
      below[*below[k].begin()].insert(std::next(below[k].begin()), below[k].end());
  }
  return sum;
}

TEST(Dissection, OrdersEachVariableOnce) {
  Graph neighbours = grid(20);
  neighbours.resize(450);  // fifty without neighbours
  std::vector<int> order = dissection_order(neighbours, all_of(neighbours));
  std::sort(order.begin(), order.end());
  EXPECT_EQ(order, all_of(neighbours));
  EXPECT_TRUE(dissection_order(neighbours, {}).empty());
}

// In row order it would be 61 000 entries.
TEST(Dissection, AGridHasLittleFill) {
  const Graph neighbours = grid(40);
  EXPECT_LT(fill(neighbours, dissection_order(neighbours, all_of(neighbours))), 28'000U);
  EXPECT_GT(fill(neighbours, all_of(neighbours)), 60'000U);
}

// No fill between the two halves of a grid whose middle row is missing.
TEST(Dissection, VariablesThatAreNotListedConnectNothing) {
  const Graph neighbours = grid(9);
  std::vector<int> without = all_of(neighbours);
  without.erase(without.begin() + 36, without.begin() + 45);
  const std::vector<int> order = dissection_order(neighbours, without);
  ASSERT_EQ(order.size(), 72U);
  const bool upper_first = order.front() < 36;
  for (std::size_t k = 0; k < 36; ++k) EXPECT_EQ(order[k] < 36, upper_first) << k;
}

TEST(Dissection, ACompleteGraphIsNotSplit) {
  Graph neighbours(60);
  for (int v = 0; v < 60; ++v)
    for (int other = 0; other < 60; ++other)
      if (other != v) neighbours[static_cast<std::size_t>(v)].push_back(other);
  EXPECT_EQ(dissection_order(neighbours, all_of(neighbours)).size(), 60U);
}

}  // namespace
}  // namespace tarsier::linalg
