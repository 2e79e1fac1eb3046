// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/extraction.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"

#include <opencv2/core/utility.hpp>

#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>

namespace tarsier::sfm {
namespace {

constexpr int kSide = VoxelVolume::kSide;
constexpr double kMinCrossingShare =
    0.01;  // of a cell's edge: min distance of crossings from its ends

struct CellEdge {
  int low = 0;  // corners
  int high = 0;
  int axis = 0;
};

const std::array<CellEdge, 12>& cell_edges() {
  static const std::array<CellEdge, 12> all = [] {
    std::array<CellEdge, 12> edges;
    std::size_t count = 0;
    for (int axis = 0; axis < 3; ++axis) {
      for (int corner = 0; corner < 8; ++corner)
        if ((corner >> axis & 1) == 0) edges[count++] = {corner, corner | 1 << axis, axis};
    }
    return edges;
  }();
  return all;
}

int edge_between(int a, int b) {
  for (int e = 0; e < 12; ++e) {
    const CellEdge& edge = cell_edges()[at(e)];
    if (edge.low == std::min(a, b) && edge.high == std::max(a, b)) return e;
  }
  return -1;
}

// Whether two edges are on one side of the cell.
bool on_same_side(int a, int b) {
  const CellEdge& first = cell_edges()[at(a)];
  const CellEdge& second = cell_edges()[at(b)];
  for (int axis = 0; axis < 3; ++axis) {
    if (axis != first.axis && axis != second.axis &&
        (first.low >> axis & 1) == (second.low >> axis & 1))
      return true;
  }
  return false;
}

// Triangulates the part of a polygon from corner `from` to `to`; empty if each triangulation has a
// diagonal in a side.
std::optional<std::vector<int>> triangulated(const std::vector<int>& polygon, int from, int to) {
  if (to - from < 2) return std::vector<int>{};
  const auto is_allowed = [&](int a, int b) {
    return b - a == 1 || !on_same_side(polygon[at(a)], polygon[at(b)]);
  };
  for (int k = from + 1; k < to; ++k) {
    if (!is_allowed(from, k) || !is_allowed(k, to)) continue;
    auto before = triangulated(polygon, from, k);
    const auto after = triangulated(polygon, k, to);
    if (!before || !after) continue;
    before->insert(before->end(), after->begin(), after->end());
    for (const int corner : {from, k, to}) before->push_back(polygon[at(corner)]);
    return before;
  }
  return std::nullopt;
}

std::vector<int> triangles_of_case(int inside) {
  // Each side has its corners in order, as seen from outside the cell. The contour goes from the
  // edge where a run of inside corners begins to the edge where it ends.
  std::array<int, 12> next{};
  next.fill(-1);
  for (int axis = 0; axis < 3; ++axis) {
    for (int high = 0; high < 2; ++high) {
      const int u = 1 << (axis + 1) % 3;
      const int v = 1 << (axis + 2) % 3;
      const int base = high << axis;
      std::array<int, 4> cycle{base, base | u, base | u | v, base | v};
      if (high == 0) std::swap(cycle[1], cycle[3]);
      const auto is_inside = [&](int i) { return (inside >> cycle[at(i % 4)] & 1) != 0; };
      for (int i = 0; i < 4; ++i) {
        if (is_inside(i) || !is_inside(i + 1)) continue;
        int last = i + 1;
        while (is_inside(last + 1)) ++last;
        next[at(edge_between(cycle[at(i)], cycle[at((i + 1) % 4)]))] =
            edge_between(cycle[at(last % 4)], cycle[at((last + 1) % 4)]);
      }
    }
  }
  std::vector<int> result;
  for (int start = 0; start < 12; ++start) {
    std::vector<int> polygon;
    for (int e = start; next[at(e)] >= 0;) {
      polygon.push_back(e);
      const int following = next[at(e)];
      next[at(e)] = -1;
      e = following;
    }
    if (polygon.empty()) continue;
    const auto triangles = triangulated(polygon, 0, static_cast<int>(polygon.size()) - 1);
    TARSIER_REQUIRE(triangles.has_value(), "no triangles for case {}", inside);
    result.insert(result.end(), triangles->begin(), triangles->end());
  }
  return result;
}

// The crossings of a block, numbered by voxel and axis.
struct Crossings {
  std::array<std::uint64_t, 3 * VoxelVolume::kVoxels / 64> mask{};  // bit 3 * voxel + axis
  std::array<std::uint16_t, 3 * VoxelVolume::kVoxels / 64> before{};
  int first = 0;  // index of the first vertex
  int count = 0;

  [[nodiscard]] int vertex(int bit) const {
    const std::size_t word = at(bit / 64);
    const std::uint64_t lower = (std::uint64_t{1} << bit % 64) - 1;
    return first + before[word] + std::popcount(mask[word] & lower);
  }
};

// A block and the seven after it along the axes: bit k of the index is a step along axis k.
class Neighborhood {
 public:
  Neighborhood(const VoxelVolume& volume, int block) {
    const VoxelVolume::Index index = volume.index(block);
    for (int k = 0; k < 8; ++k) {
      block_[at(k)] =
          k == 0 ? block : volume.find(index + VoxelVolume::Index(k & 1, k >> 1 & 1, k >> 2));
      if (block_[at(k)] >= 0) voxels_[at(k)] = volume.voxels(block_[at(k)]).data();
    }
  }

  struct Location {
    int block = -1;
    int voxel = 0;
  };
  // x, y, z: 0..8.
  [[nodiscard]] Location location(int x, int y, int z) const {
    return {block_[at(which(x, y, z))], local(x, y, z)};
  }
  [[nodiscard]] const Voxel* voxel(int x, int y, int z) const {
    const Voxel* voxels = voxels_[at(which(x, y, z))];
    if (voxels == nullptr) return nullptr;
    const Voxel& found = voxels[local(x, y, z)];
    return found.weight > 0 ? &found : nullptr;
  }

 private:
  static int which(int x, int y, int z) { return x / kSide | y / kSide << 1 | z / kSide << 2; }
  static int local(int x, int y, int z) {
    return x % kSide + kSide * (y % kSide + kSide * (z % kSide));
  }
  std::array<int, 8> block_{};
  std::array<const Voxel*, 8> voxels_{};
};

template <class Take>
void for_each_voxel(const Take& take) {
  for (int z = 0; z < kSide; ++z)
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x) take(x, y, z);
}

Crossings crossings_of(const Neighborhood& around) {
  Crossings result;
  for_each_voxel([&](int x, int y, int z) {
    const Voxel* here = around.voxel(x, y, z);
    if (here == nullptr) return;
    for (int axis = 0; axis < 3; ++axis) {
      const Voxel* there = around.voxel(x + (axis == 0), y + (axis == 1), z + (axis == 2));
      if (there == nullptr || (here->distance < 0) == (there->distance < 0)) continue;
      const int bit = 3 * (x + kSide * (y + kSide * z)) + axis;
      result.mask[at(bit / 64)] |= std::uint64_t{1} << bit % 64;
    }
  });
  for (std::size_t w = 0; w < result.mask.size(); ++w) {
    result.before[w] = static_cast<std::uint16_t>(result.count);
    result.count += std::popcount(result.mask[w]);
  }
  return result;
}

void place_vertices(const VoxelVolume& volume, int block, const Crossings& crossings,
                    SurfaceMesh& mesh) {
  if (crossings.count == 0) return;
  const Neighborhood around(volume, block);
  const Eigen::Vector3d first = volume.index(block).cast<double>() * kSide;
  for_each_voxel([&](int x, int y, int z) {
    for (int axis = 0; axis < 3; ++axis) {
      const int bit = 3 * (x + kSide * (y + kSide * z)) + axis;
      if ((crossings.mask[at(bit / 64)] >> bit % 64 & 1) == 0) continue;
      const auto here = static_cast<double>(around.voxel(x, y, z)->distance);
      const auto there = static_cast<double>(
          around.voxel(x + (axis == 0), y + (axis == 1), z + (axis == 2))->distance);
      Eigen::Vector3d position = first + Eigen::Vector3d(x, y, z);
      position[axis] += std::clamp(here / (here - there), kMinCrossingShare, 1 - kMinCrossingShare);
      mesh.vertices[at(crossings.vertex(bit))] = (position * volume.size()).cast<float>();
    }
  });
}

void add_faces(const VoxelVolume& volume, int block, const std::vector<Crossings>& crossings,
               float max_jump, std::vector<Face>& faces) {
  const Neighborhood around(volume, block);
  for_each_voxel([&](int x, int y, int z) {
    std::array<float, 8> distance{};
    int inside = 0;
    for (int c = 0; c < 8; ++c) {
      const Voxel* voxel = around.voxel(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2));
      if (voxel == nullptr) return;
      distance[at(c)] = voxel->distance;
      inside |= (voxel->distance < 0 ? 1 : 0) << c;
    }
    const std::vector<int>& triangles = cell_triangles()[at(inside)];
    if (triangles.empty()) return;
    for (const CellEdge& edge : cell_edges()) {
      const bool crosses = (inside >> edge.low & 1) != (inside >> edge.high & 1);
      if (crosses && std::abs(distance[at(edge.high)] - distance[at(edge.low)]) > max_jump) return;
    }
    for (std::size_t t = 0; t < triangles.size(); t += 3) {
      Face face{};
      for (std::size_t k = 0; k < 3; ++k) {
        const CellEdge& edge = cell_edges()[at(triangles[t + k])];
        const int c = edge.low;
        const auto location = around.location(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2));
        face[k] = crossings[at(location.block)].vertex(3 * location.voxel + edge.axis);
      }
      faces.push_back(face);
    }
  });
}

}  // namespace

const std::vector<std::vector<int>>& cell_triangles() {
  static const std::vector<std::vector<int>> all = [] {
    std::vector<std::vector<int>> cases;
    cases.reserve(256);
    for (int inside = 0; inside < 256; ++inside) cases.push_back(triangles_of_case(inside));
    return cases;
  }();
  return all;
}

SurfaceMesh extract_surface(const VoxelVolume& volume, double max_jump) {
  TARSIER_REQUIRE(max_jump > 0, "{}", max_jump);
  const int blocks = volume.blocks();
  std::vector<Crossings> crossings(at(blocks));
  const auto in_parallel = [&](const auto& work) {
    cv::parallel_for_(cv::Range(0, blocks), [&](const cv::Range& range) {
      for (int b = range.start; b < range.end; ++b) work(b);
    });
  };
  in_parallel([&](int b) { crossings[at(b)] = crossings_of(Neighborhood(volume, b)); });
  std::int64_t count = 0;
  for (Crossings& block : crossings) {
    block.first = static_cast<int>(count);
    count += block.count;
    TARSIER_REQUIRE(count < std::numeric_limits<int>::max() / 8, "too many vertices");
  }
  SurfaceMesh mesh;
  mesh.vertices.resize(static_cast<std::size_t>(count));
  in_parallel([&](int b) { place_vertices(volume, b, crossings[at(b)], mesh); });
  std::vector<std::vector<Face>> faces(at(blocks));
  in_parallel(
      [&](int b) { add_faces(volume, b, crossings, static_cast<float>(max_jump), faces[at(b)]); });
  for (const std::vector<Face>& block : faces)
    mesh.faces.insert(mesh.faces.end(), block.begin(), block.end());
  remove_unused_vertices(mesh);
  split_touching_vertices(mesh);
  return mesh;
}

}  // namespace tarsier::sfm
