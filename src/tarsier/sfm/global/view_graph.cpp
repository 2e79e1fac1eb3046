// SPDX-License-Identifier: MIT
#include "tarsier/sfm/global/view_graph.h"

#include "tarsier/core/require.h"
#include "tarsier/geometry/rigid3.h"

#include <algorithm>
#include <numbers>
#include <numeric>
#include <utility>

namespace tarsier::sfm {
namespace {

std::size_t at(int i) { return static_cast<std::size_t>(i); }

}  // namespace

Components::Components(std::size_t count) : parents_(count) {
  std::iota(parents_.begin(), parents_.end(), 0);
}

int Components::root(int node) {
  while (parents_[at(node)] != node) node = parents_[at(node)] = parents_[at(parents_[at(node)])];
  return node;
}

bool Components::join(int a, int b) {
  a = root(a);
  b = root(b);
  parents_[at(a)] = b;
  return a != b;
}

std::vector<CycleSupport> check_cycles(int nodes, const std::vector<RelativeRotation>& edges,
                                       double max_deg) {
  // Of each node its neighbours with a greater number, ascending, and the edges to them.
  std::vector<std::vector<std::pair<int, int>>> next(at(nodes));
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const auto [low, high] = std::minmax(edges[e].first, edges[e].second);
    TARSIER_REQUIRE(low >= 0 && high < nodes && low != high, "an edge from {} to {} among {} nodes",
                    edges[e].first, edges[e].second, nodes);
    next[at(low)].emplace_back(high, static_cast<int>(e));
  }
  for (auto& neighbours : next) std::sort(neighbours.begin(), neighbours.end());
  const auto rotation = [&](int edge, int from) {
    const RelativeRotation& relative = edges[at(edge)];
    return relative.first == from ? relative.second_from_first
                                  : Eigen::Matrix3d(relative.second_from_first.transpose());
  };
  const double limit = max_deg * std::numbers::pi / 180;
  std::vector<CycleSupport> support(edges.size());
  for (int a = 0; a < nodes; ++a) {
    const auto& of_a = next[at(a)];
    for (const auto& [b, ab] : of_a) {
      const auto& of_b = next[at(b)];
      auto p = of_a.begin();
      auto q = of_b.begin();
      while (p != of_a.end() && q != of_b.end()) {
        if (p->first != q->first) {
          p->first < q->first ? static_cast<void>(++p) : static_cast<void>(++q);
          continue;
        }
        const Eigen::Matrix3d around =
            rotation(p->second, p->first) * rotation(q->second, b) * rotation(ab, a);
        const int closed = geometry::angle_of(around) <= limit ? 1 : 0;
        for (const int edge : {ab, p->second, q->second}) {
          ++support[at(edge)].cycles;
          support[at(edge)].closed += closed;
        }
        ++p;
        ++q;
      }
    }
  }
  return support;
}

std::vector<int> largest_component(int nodes, const std::vector<RelativeRotation>& edges) {
  Components components(at(nodes));
  for (const RelativeRotation& edge : edges) components.join(edge.first, edge.second);
  std::vector<std::vector<int>> members(at(nodes));
  for (int node = 0; node < nodes; ++node) members[at(components.root(node))].push_back(node);
  const auto less = [](const std::vector<int>& a, const std::vector<int>& b) {
    return a.size() != b.size() ? a.size() < b.size() : !a.empty() && a.front() > b.front();
  };
  const auto best = std::max_element(members.begin(), members.end(), less);
  return best == members.end() ? std::vector<int>{} : *best;
}

}  // namespace tarsier::sfm
