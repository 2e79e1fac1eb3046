// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/triangle_tree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr int kLeafFaces = 4;

float squared_distance_to_side(const Eigen::Vector3f& from, const Eigen::Vector3f& a,
                               const Eigen::Vector3f& b) {
  const Eigen::Vector3f side = b - a;
  const float length = side.squaredNorm();
  const float t = length > 0 ? std::clamp(side.dot(from - a) / length, 0.F, 1.F) : 0.F;
  return (from - a - t * side).squaredNorm();
}

}  // namespace

float triangle_distance(const Eigen::Vector3f& from, const Eigen::Vector3f& a,
                        const Eigen::Vector3f& b, const Eigen::Vector3f& c) {
  const Eigen::Vector3f normal = (b - a).cross(c - a);
  const float doubled_area = normal.squaredNorm();
  if (doubled_area > 0) {
    const auto is_left_of = [&](const Eigen::Vector3f& p, const Eigen::Vector3f& q) {
      return normal.dot((q - p).cross(from - p)) >= 0;
    };
    if (is_left_of(a, b) && is_left_of(b, c) && is_left_of(c, a))
      return std::abs(normal.dot(from - a)) / std::sqrt(doubled_area);
  }
  return std::sqrt(
      std::min({squared_distance_to_side(from, a, b), squared_distance_to_side(from, b, c),
                squared_distance_to_side(from, c, a)}));
}

TriangleTree::TriangleTree(SurfaceMesh mesh) : mesh_(std::move(mesh)) {
  mesh_.check();
  order_.resize(mesh_.faces.size());
  std::iota(order_.begin(), order_.end(), 0);
  if (order_.empty()) return;
  std::vector<Eigen::Vector3f> centroids;
  centroids.reserve(order_.size());
  for (int face = 0; face < static_cast<int>(order_.size()); ++face)
    centroids.emplace_back((corner(face, 0) + corner(face, 1) + corner(face, 2)) / 3);
  nodes_.reserve(order_.size());
  build(0, static_cast<int>(order_.size()), centroids);
}

const Eigen::Vector3f& TriangleTree::corner(int face, int k) const {
  const int vertex = mesh_.faces[static_cast<std::size_t>(face)][static_cast<std::size_t>(k)];
  return mesh_.vertices[static_cast<std::size_t>(vertex)];
}

int TriangleTree::build(int begin, int end, const std::vector<Eigen::Vector3f>& centroids) {
  const auto number = nodes_.size();
  nodes_.emplace_back();
  Eigen::AlignedBox3f box;
  Eigen::AlignedBox3f centroid_box;
  for (int i = begin; i < end; ++i) {
    const int face = order_[static_cast<std::size_t>(i)];
    for (int k = 0; k < 3; ++k) box.extend(corner(face, k));
    centroid_box.extend(centroids[static_cast<std::size_t>(face)]);
  }
  nodes_[number].box = box;
  if (end - begin <= kLeafFaces) {
    nodes_[number].begin = begin;
    nodes_[number].end = end;
    return static_cast<int>(number);
  }
  Eigen::Index axis = 0;
  centroid_box.sizes().maxCoeff(&axis);
  const int half = begin + (end - begin) / 2;
  std::nth_element(order_.begin() + begin, order_.begin() + half, order_.begin() + end,
                   [&](int p, int q) {
                     const float at_p = centroids[static_cast<std::size_t>(p)][axis];
                     const float at_q = centroids[static_cast<std::size_t>(q)][axis];
                     return at_p != at_q ? at_p < at_q : p < q;
                   });
  const int left = build(begin, half, centroids);
  const int right = build(half, end, centroids);
  nodes_[number].left = left;
  nodes_[number].right = right;
  return static_cast<int>(number);
}

float TriangleTree::distance(const Eigen::Vector3f& from, float limit) const {
  if (nodes_.empty()) return limit;
  float best = limit;
  std::array<std::pair<float, int>, 64> pending;  // median splits limit the depth
  std::size_t count = 0;
  const auto put = [&](int node) {
    const float distance_to_box = nodes_[static_cast<std::size_t>(node)].box.exteriorDistance(from);
    if (distance_to_box < best) pending[count++] = {distance_to_box, node};
  };
  put(0);
  while (count > 0) {
    const auto [distance_to_box, number] = pending[--count];
    if (distance_to_box >= best) continue;
    const Node& node = nodes_[static_cast<std::size_t>(number)];
    if (node.left < 0) {
      for (int i = node.begin; i < node.end; ++i) {
        const int face = order_[static_cast<std::size_t>(i)];
        best = std::min(best,
                        triangle_distance(from, corner(face, 0), corner(face, 1), corner(face, 2)));
      }
      continue;
    }
    const std::size_t before = count;
    put(node.left);
    put(node.right);
    if (count == before + 2 && pending[before].first < pending[before + 1].first)
      std::swap(pending[before], pending[before + 1]);  // visit the nearer one first
  }
  return best;
}

}  // namespace tarsier::sfm
