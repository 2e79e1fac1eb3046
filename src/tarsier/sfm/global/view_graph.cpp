// SPDX-License-Identifier: MIT
#include "tarsier/sfm/global/view_graph.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"
#include "tarsier/geometry/rigid3.h"

#include <algorithm>
#include <numbers>
#include <numeric>
#include <utility>

namespace tarsier::sfm {
namespace {

struct Search {
  std::vector<int> order;     // nodes, the nearest first
  std::vector<int> distance;  // per node; -1: not reached
  std::vector<int> previous;  // per node: the previous node
};

Search breadth_first(const std::vector<std::vector<int>>& neighbours, int start) {
  Search search;
  search.order.push_back(start);
  search.distance.assign(neighbours.size(), -1);
  search.previous.assign(neighbours.size(), start);
  search.distance[at(start)] = 0;
  for (std::size_t k = 0; k < search.order.size(); ++k) {
    const int node = search.order[k];
    for (const int other : neighbours[at(node)]) {
      if (search.distance[at(other)] >= 0) continue;
      search.distance[at(other)] = search.distance[at(node)] + 1;
      search.previous[at(other)] = node;
      search.order.push_back(other);
    }
  }
  return search;
}

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
  // For each node: its neighbours with a greater index, ascending, and the edges to them.
  std::vector<std::vector<std::pair<int, int>>> next(at(nodes));
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const auto [low, high] = std::minmax(edges[e].first, edges[e].second);
    TARSIER_REQUIRE(low >= 0 && high < nodes && low != high,
                    "edge from {} to {}, in a graph of {} nodes", edges[e].first, edges[e].second,
                    nodes);
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
        const Eigen::Matrix3d cycle_rotation =
            rotation(p->second, p->first) * rotation(q->second, b) * rotation(ab, a);
        const int closed = geometry::angle_of(cycle_rotation) <= limit ? 1 : 0;
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

int radius(int nodes, const std::vector<RelativeRotation>& edges) {
  if (nodes == 0) return 0;
  std::vector<std::vector<int>> neighbours(at(nodes));
  for (const RelativeRotation& edge : edges) {
    neighbours[at(edge.first)].push_back(edge.second);
    neighbours[at(edge.second)].push_back(edge.first);
  }
  const Search longest_path = breadth_first(neighbours, breadth_first(neighbours, 0).order.back());
  int center = longest_path.order.back();
  for (int k = longest_path.distance[at(center)] / 2; k > 0; --k)
    center = longest_path.previous[at(center)];
  const Search from_center = breadth_first(neighbours, center);
  return from_center.distance[at(from_center.order.back())];
}

}  // namespace tarsier::sfm
