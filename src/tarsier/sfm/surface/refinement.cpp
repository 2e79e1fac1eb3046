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
constexpr int kSweeps = 200;
constexpr float kInwards = 0.5F;
constexpr float kOutwards = -0.53F;

// The sorted vertices around each vertex; for boundary vertices only the neighbours on the
// boundary.
struct Around {
  std::vector<int> first;
  std::vector<int> list;
};

Around around_vertices(const SurfaceMesh& mesh) {
  const std::vector<Face> neighbors = face_neighbors(mesh);
  std::vector<char> is_boundary(mesh.vertices.size(), 0);
  const auto each_edge = [&](const auto& take) {
    for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
      for (std::size_t k = 0; k < 3; ++k)
        take(mesh.faces[f][k], mesh.faces[f][(k + 1) % 3], neighbors[f][k] < 0);
    }
  };
  each_edge([&](int a, int b, bool boundary) {
    if (boundary) is_boundary[at(a)] = is_boundary[at(b)] = 1;
  });
  // An inner edge comes from both of its faces; each adds it to the vertex where it starts.
  Around around;
  around.first.assign(mesh.vertices.size() + 1, 0);
  const auto each_neighbor = [&](const auto& take) {
    each_edge([&](int a, int b, bool boundary) {
      if (boundary) {
        take(a, b);
        take(b, a);
      } else if (is_boundary[at(a)] == 0) {
        take(a, b);
      }
    });
  };
  each_neighbor([&](int a, int) { ++around.first[at(a) + 1]; });
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) around.first[v + 1] += around.first[v];
  around.list.resize(at(around.first.back()));
  std::vector<int> next(around.first.begin(), around.first.end() - 1);
  each_neighbor([&](int a, int b) { around.list[at(next[at(a)]++)] = b; });
  return around;
}

Eigen::Vector3f mean_around(const Around& around, int v,
                            const std::vector<Eigen::Vector3f>& vertices) {
  const int begin = around.first[at(v)];
  const int end = around.first[at(v) + 1];
  Eigen::Vector3f sum = Eigen::Vector3f::Zero();
  for (int i = begin; i < end; ++i) sum += vertices[at(around.list[at(i)])];
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
      const float place =
          static_cast<float>(j) * static_cast<float>(count) / static_cast<float>(size);
      const int before = std::min(count - 1, static_cast<int>(place));
      const float part = place - static_cast<float>(before);
      const Eigen::Vector3f& a = mesh.vertices[at(loop.vertices[at(before)])];
      const Eigen::Vector3f& b = mesh.vertices[at(loop.vertices[at((before + 1) % count)])];
      const Eigen::Vector3f rim = a + part * (b - a);
      inner.push_back(add_vertex(center + share * (rim - center), mean_color));
    }
    stitch(outer, inner, mesh.faces);
    outer = std::move(inner);
  }
  const int middle = add_vertex(center, mean_color);
  for (std::size_t i = 0; i < outer.size(); ++i)
    mesh.faces.push_back({outer[(i + 1) % outer.size()], outer[i], middle});
}

}  // namespace

int close_holes(SurfaceMesh& mesh, double diameter) {
  TARSIER_REQUIRE(diameter >= 0, "{}", diameter);
  const std::size_t known = mesh.vertices.size();
  int closed = 0;
  for (const BoundaryLoop& loop : boundary_loops(mesh)) {
    if (!(loop.diameter <= diameter)) continue;
    close(mesh, loop);
    ++closed;
  }
  if (mesh.vertices.size() == known) return closed;
  const Around around = around_vertices(mesh);
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    for (std::size_t v = known; v < mesh.vertices.size(); ++v)
      mesh.vertices[v] = mean_around(around, static_cast<int>(v), mesh.vertices);
  }
  return closed;
}

void smooth_surface(SurfaceMesh& mesh, int iterations) {
  TARSIER_REQUIRE(iterations >= 0, "{}", iterations);
  if (iterations == 0) return;
  const Around around = around_vertices(mesh);
  std::vector<Eigen::Vector3f> moved(mesh.vertices.size());
  for (int step = 0; step < 2 * iterations; ++step) {
    const float share = step % 2 == 0 ? kInwards : kOutwards;
    cv::parallel_for_(cv::Range(0, static_cast<int>(moved.size())), [&](const cv::Range& range) {
      for (int v = range.start; v < range.end; ++v) {
        const Eigen::Vector3f& here = mesh.vertices[at(v)];
        moved[at(v)] = here + share * (mean_around(around, v, mesh.vertices) - here);
      }
    });
    mesh.vertices.swap(moved);
  }
}

}  // namespace tarsier::sfm
