// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/refinement.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::sfm {
namespace {

constexpr int kMaxRings = 24;
constexpr int kMembraneSweeps = 200;
constexpr float kTaubinLambda = 0.5F;
constexpr float kTaubinMu = -0.53F;

// The sorted vertices around each vertex; for boundary vertices only the neighbours on the
// boundary.
struct Adjacency {
  std::vector<int> first;
  std::vector<int> list;
};

Adjacency adjacency_of(const SurfaceMesh& mesh) {
  const std::vector<Face> neighbors = face_neighbors(mesh);
  std::vector<char> is_boundary(mesh.vertices.size(), 0);
  const auto for_each_edge = [&](const auto& take) {
    for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
      for (std::size_t k = 0; k < 3; ++k)
        take(mesh.faces[f][k], mesh.faces[f][(k + 1) % 3], neighbors[f][k] < 0);
    }
  };
  for_each_edge([&](int a, int b, bool boundary) {
    if (boundary) is_boundary[at(a)] = is_boundary[at(b)] = 1;
  });
  // An inner edge comes from both of its faces; each adds it to the vertex where it starts.
  Adjacency adjacency;
  adjacency.first.assign(mesh.vertices.size() + 1, 0);
  const auto for_each_neighbor = [&](const auto& take) {
    for_each_edge([&](int a, int b, bool boundary) {
      if (boundary) {
        take(a, b);
        take(b, a);
      } else if (is_boundary[at(a)] == 0) {
        take(a, b);
      }
    });
  };
  for_each_neighbor([&](int a, int) { ++adjacency.first[at(a) + 1]; });
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v)
    adjacency.first[v + 1] += adjacency.first[v];
  adjacency.list.resize(at(adjacency.first.back()));
  std::vector<int> next(adjacency.first.begin(), adjacency.first.end() - 1);
  for_each_neighbor([&](int a, int b) { adjacency.list[at(next[at(a)]++)] = b; });
  return adjacency;
}

Eigen::Vector3f mean_around(const Adjacency& adjacency, int v,
                            const std::vector<Eigen::Vector3f>& vertices) {
  const int begin = adjacency.first[at(v)];
  const int end = adjacency.first[at(v) + 1];
  Eigen::Vector3f sum = Eigen::Vector3f::Zero();
  for (int i = begin; i < end; ++i) sum += vertices[at(adjacency.list[at(i)])];
  return end > begin ? Eigen::Vector3f(sum / static_cast<float>(end - begin)) : vertices[at(v)];
}

// Adds triangles between two rings; the surface is to the left of `outer`. Both rings start at the
// same side, and the one that lags behind advances.
void stitch(const std::vector<int>& outer, const std::vector<int>& inner,
            std::vector<Face>& faces) {
  const std::size_t m = outer.size();
  const std::size_t k = inner.size();
  std::size_t i = 0;
  std::size_t j = 0;
  while (i < m || j < k) {
    if (j == k || (i < m && (i + 1) * k <= (j + 1) * m)) {
      faces.push_back({outer[(i + 1) % m], outer[i % m], inner[j % k]});
      ++i;
    } else {
      faces.push_back({outer[i % m], inner[j % k], inner[(j + 1) % k]});
      ++j;
    }
  }
}

void close(SurfaceMesh& mesh, const BoundaryLoop& loop) {
  const int count = static_cast<int>(loop.vertices.size());
  const auto add_vertex = [&](const Eigen::Vector3f& position, const cv::Vec3f& color) {
    mesh.vertices.push_back(position);
    if (!mesh.colors.empty()) mesh.colors.push_back(cv::Vec3b(color));
    return static_cast<int>(mesh.vertices.size()) - 1;
  };
  cv::Vec3f mean_color(0, 0, 0);
  if (!mesh.colors.empty()) {
    for (const int v : loop.vertices)
      mean_color += cv::Vec3f(mesh.colors[at(v)]) / static_cast<float>(count);
  }
  if (count == 3) {
    mesh.faces.push_back({loop.vertices[2], loop.vertices[1], loop.vertices[0]});
    return;
  }
  const Eigen::Vector3f center = loop.center.cast<float>();
  const int rings = std::min(kMaxRings, static_cast<int>(std::lround(count / 6.3)) - 1);
  std::vector<int> outer = loop.vertices;
  for (int ring = 1; ring <= rings; ++ring) {
    const float share = 1 - static_cast<float>(ring) / static_cast<float>(rings + 1);
    const int size = std::max(6, static_cast<int>(std::lround(static_cast<float>(count) * share)));
    std::vector<int> inner;
    for (int j = 0; j < size; ++j) {
      const float position =
          static_cast<float>(j) * static_cast<float>(count) / static_cast<float>(size);
      const int before = std::min(count - 1, static_cast<int>(position));
      const float part = position - static_cast<float>(before);
      const Eigen::Vector3f& a = mesh.vertices[at(loop.vertices[at(before)])];
      const Eigen::Vector3f& b = mesh.vertices[at(loop.vertices[at((before + 1) % count)])];
      const Eigen::Vector3f rim = a + part * (b - a);
      inner.push_back(add_vertex(center + share * (rim - center), mean_color));
    }
    stitch(outer, inner, mesh.faces);
    outer = std::move(inner);
  }
  const int center_vertex = add_vertex(center, mean_color);
  for (std::size_t i = 0; i < outer.size(); ++i)
    mesh.faces.push_back({outer[(i + 1) % outer.size()], outer[i], center_vertex});
}

}  // namespace

int close_holes(SurfaceMesh& mesh, double diameter) {
  TARSIER_REQUIRE(diameter >= 0, "{}", diameter);
  const std::size_t old_count = mesh.vertices.size();
  int closed = 0;
  for (const BoundaryLoop& loop : boundary_loops(mesh)) {
    if (!(loop.diameter <= diameter)) continue;
    close(mesh, loop);
    ++closed;
  }
  if (mesh.vertices.size() == old_count) return closed;
  const Adjacency adjacency = adjacency_of(mesh);
  for (int sweep = 0; sweep < kMembraneSweeps; ++sweep) {
    for (std::size_t v = old_count; v < mesh.vertices.size(); ++v)
      mesh.vertices[v] = mean_around(adjacency, static_cast<int>(v), mesh.vertices);
  }
  return closed;
}

void smooth_surface(SurfaceMesh& mesh, int iterations) {
  TARSIER_REQUIRE(iterations >= 0, "{}", iterations);
  if (iterations == 0) return;
  const Adjacency adjacency = adjacency_of(mesh);
  std::vector<Eigen::Vector3f> moved(mesh.vertices.size());
  for (int step = 0; step < 2 * iterations; ++step) {
    const float share = step % 2 == 0 ? kTaubinLambda : kTaubinMu;
    cv::parallel_for_(cv::Range(0, static_cast<int>(moved.size())), [&](const cv::Range& range) {
      for (int v = range.start; v < range.end; ++v) {
        const Eigen::Vector3f& here = mesh.vertices[at(v)];
        moved[at(v)] = here + share * (mean_around(adjacency, v, mesh.vertices) - here);
      }
    });
    mesh.vertices.swap(moved);
  }
}

}  // namespace tarsier::sfm
