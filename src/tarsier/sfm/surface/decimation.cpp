// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/decimation.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"

#include <Eigen/Geometry>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <queue>
#include <tuple>

namespace tarsier::sfm {
namespace {

constexpr double kMinCosine = 0.2;      // between a face's normals before and after
constexpr double kBoundaryWeight = 10;  // weight of the planes of the boundary
// keeps the new vertex near the edge where planes do not determine it
constexpr double kStiffness = 1e-3;
constexpr int kStopInterval = 4096;

// x' A x + 2 b' x + c: sum of weighted squared distances to planes.
struct Quadric {
  Eigen::Matrix3d a = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  double c = 0;
  double weight = 0;

  void add_plane(const Eigen::Vector3d& normal, const Eigen::Vector3d& point, double plane_weight) {
    const double offset = -normal.dot(point);
    a += plane_weight * normal * normal.transpose();
    b += plane_weight * offset * normal;
    c += plane_weight * offset * offset;
    weight += plane_weight;
  }
  void add(const Quadric& other) {
    a += other.a;
    b += other.b;
    c += other.c;
    weight += other.weight;
  }
  [[nodiscard]] double at(const Eigen::Vector3d& x) const {
    return x.dot(a * x) + 2 * b.dot(x) + c;
  }
};

struct Candidate {
  double cost = 0;
  int a = 0;  // vertices, a < b
  int b = 0;
  int stamp = 0;                                                // sum of the vertices' stamps
  [[nodiscard]] bool operator<(const Candidate& other) const {  // the heap returns the largest
    return std::tie(cost, a, b, stamp) > std::tie(other.cost, other.a, other.b, other.stamp);
  }
};

class Decimator {
 public:
  explicit Decimator(SurfaceMesh& mesh) : mesh_(mesh) {
    // Coordinates are relative to the centre, so that quadrics of small meshes far from the origin
    // are exact.
    for (const Eigen::Vector3f& v : mesh.vertices) centroid_ += v.cast<double>();
    if (!mesh.vertices.empty()) centroid_ /= static_cast<double>(mesh.vertices.size());
    for (const Eigen::Vector3f& v : mesh.vertices)
      vertices_.emplace_back(v.cast<double>() - centroid_);
    stamps_.assign(vertices_.size(), 0);
    quadrics_.resize(vertices_.size());
    faces_of_.resize(vertices_.size());
    boundary_.assign(vertices_.size(), 0);
    face_count_ = static_cast<int>(mesh.faces.size());
    for (std::size_t f = 0; f < mesh.faces.size(); ++f)
      for (const int v : mesh.faces[f]) faces_of_[at(v)].push_back(static_cast<int>(f));
    add_quadrics();
    for (int a = 0; a < static_cast<int>(vertices_.size()); ++a) {
      for (const int b : around(a))
        if (a < b) push(a, b);
    }
  }

  void run(int faces, const std::stop_token& stop) {
    for (int step = 0; face_count_ > faces && !heap_.empty(); ++step) {
      if (step % kStopInterval == 0) throw_if_stopped(stop);
      const Candidate best = heap_.top();
      heap_.pop();
      if (stamps_[at(best.a)] < 0 || stamps_[at(best.b)] < 0 ||
          best.stamp != stamps_[at(best.a)] + stamps_[at(best.b)])
        continue;
      collapse(best.a, best.b);
    }
    store();
  }

 private:
  [[nodiscard]] const Face& face(int f) const { return mesh_.faces[at(f)]; }

  void add_quadrics() {
    const std::vector<Face> neighbors = face_neighbors(mesh_);
    for (std::size_t f = 0; f < mesh_.faces.size(); ++f) {
      const Face& corners = mesh_.faces[f];
      const Eigen::Vector3d& p = vertices_[at(corners[0])];
      const Eigen::Vector3d cross =
          (vertices_[at(corners[1])] - p).cross(vertices_[at(corners[2])] - p);
      const double area = 0.5 * cross.norm();
      if (!(area > 0)) continue;
      const Eigen::Vector3d normal = cross.normalized();
      for (const int v : corners) quadrics_[at(v)].add_plane(normal, p, area);
      for (std::size_t k = 0; k < 3; ++k) {
        if (neighbors[f][k] >= 0) continue;
        const int a = corners[k];
        const int b = corners[(k + 1) % 3];
        boundary_[at(a)] = boundary_[at(b)] = 1;
        const Eigen::Vector3d edge = vertices_[at(b)] - vertices_[at(a)];
        const Eigen::Vector3d upright = edge.cross(normal);
        if (!(upright.norm() > 0)) continue;
        for (const int v : {a, b}) {
          quadrics_[at(v)].add_plane(upright.normalized(), vertices_[at(a)],
                                     kBoundaryWeight * edge.squaredNorm());
        }
      }
    }
  }

  // Sorted, without duplicates.
  [[nodiscard]] std::vector<int> around(int v) const {
    std::vector<int> result;
    for (const int f : faces_of_[at(v)])
      for (const int other : face(f))
        if (other != v) result.push_back(other);
    std::sort(result.begin(), result.end());
    result.erase(std::unique(result.begin(), result.end()), result.end());
    return result;
  }

  [[nodiscard]] Eigen::Vector3d optimal_position(int a, int b, double& cost) const {
    Quadric sum = quadrics_[at(a)];
    sum.add(quadrics_[at(b)]);
    const Eigen::Vector3d edge_center = 0.5 * (vertices_[at(a)] + vertices_[at(b)]);
    const double stiffness = kStiffness * sum.weight + 1e-300;
    const Eigen::Matrix3d matrix = sum.a + stiffness * Eigen::Matrix3d::Identity();
    Eigen::Vector3d position = matrix.inverse() * (stiffness * edge_center - sum.b);
    const double length = (vertices_[at(a)] - vertices_[at(b)]).norm();
    if (!position.allFinite() || (position - edge_center).norm() > 2 * length)
      position = edge_center;
    // On flat surfaces, short edges come first.
    cost = std::max(0.0, sum.at(position)) + 1e-6 * sum.weight * length * length;
    return position;
  }

  void push(int a, int b) {
    Candidate candidate;
    candidate.a = std::min(a, b);
    candidate.b = std::max(a, b);
    candidate.stamp = stamps_[at(a)] + stamps_[at(b)];
    (void)optimal_position(candidate.a, candidate.b, candidate.cost);
    heap_.push(candidate);
  }

  // Whether a face of `v` without `other` would fold.
  [[nodiscard]] bool would_flip(int v, int other, const Eigen::Vector3d& position) const {
    for (const int f : faces_of_[at(v)]) {
      const Face& corners = face(f);
      std::size_t corner_index = 0;
      bool shared = false;
      for (std::size_t k = 0; k < 3; ++k) {
        if (corners[k] == v) corner_index = k;
        shared = shared || corners[k] == other;
      }
      if (shared) continue;
      const Eigen::Vector3d& p = vertices_[at(corners[(corner_index + 1) % 3])];
      const Eigen::Vector3d& q = vertices_[at(corners[(corner_index + 2) % 3])];
      const Eigen::Vector3d before = (p - vertices_[at(v)]).cross(q - vertices_[at(v)]);
      const Eigen::Vector3d after = (p - position).cross(q - position);
      const double size = after.norm();
      if (!(size > 1e-3 * (q - p).norm() * std::max((p - position).norm(), (q - position).norm())))
        return true;  // degenerate face
      // A face that was degenerate before may change in any way.
      if (before.norm() > 0 && before.dot(after) < kMinCosine * before.norm() * size) return true;
    }
    return false;
  }

  [[nodiscard]] bool preserves_topology(int a, int b) const {
    int shared = 0;
    for (const int f : faces_of_[at(a)]) {
      const Face& corners = face(f);
      if (std::find(corners.begin(), corners.end(), b) != corners.end()) ++shared;
    }
    const std::vector<int> first = around(a);
    const std::vector<int> second = around(b);
    std::vector<int> common;
    std::set_intersection(first.begin(), first.end(), second.begin(), second.end(),
                          std::back_inserter(common));
    if (static_cast<int>(common.size()) != shared || shared < 1 || shared > 2) return false;
    if (boundary_[at(a)] != 0 && boundary_[at(b)] != 0 && shared == 2) return false;
    // A tetrahedron would become a pair of triangles; a boundary of three edges would vanish.
    if (shared == 2 && first.size() == 3 && second.size() == 3) return false;
    if (shared == 1 && (first.size() == 2 || second.size() == 2)) return false;
    return true;
  }

  void collapse(int a, int b) {
    if (!preserves_topology(a, b)) return;
    double cost = 0;
    const Eigen::Vector3d position = optimal_position(a, b, cost);
    if (would_flip(a, b, position) || would_flip(b, a, position)) return;
    vertices_[at(a)] = position;
    quadrics_[at(a)].add(quadrics_[at(b)]);
    boundary_[at(a)] = static_cast<char>(boundary_[at(a)] | boundary_[at(b)]);
    std::vector<int> remaining_faces;
    for (const int f : faces_of_[at(a)]) {
      const Face corners = face(f);
      if (std::find(corners.begin(), corners.end(), b) == corners.end()) {
        remaining_faces.push_back(f);
        continue;
      }
      for (const int v : corners) {
        if (v != a) std::erase(faces_of_[at(v)], f);
      }
      mesh_.faces[at(f)] = {-1, -1, -1};
      --face_count_;
    }
    for (const int f : faces_of_[at(b)]) {
      for (int& v : mesh_.faces[at(f)])
        if (v == b) v = a;
      remaining_faces.push_back(f);
    }
    std::sort(remaining_faces.begin(), remaining_faces.end());
    faces_of_[at(a)] = std::move(remaining_faces);
    faces_of_[at(b)] = {};
    stamps_[at(b)] = -1;
    ++stamps_[at(a)];
    for (const int v : around(a)) push(a, v);
  }

  void store() {
    for (std::size_t v = 0; v < vertices_.size(); ++v)
      mesh_.vertices[v] = (vertices_[v] + centroid_).cast<float>();
    std::erase_if(mesh_.faces, [](const Face& corners) { return corners[0] < 0; });
    mesh_.colors.clear();
    remove_unused_vertices(mesh_);
  }

  SurfaceMesh& mesh_;
  Eigen::Vector3d centroid_ = Eigen::Vector3d::Zero();
  std::vector<Eigen::Vector3d> vertices_;
  std::vector<Quadric> quadrics_;
  std::vector<std::vector<int>> faces_of_;
  std::vector<int> stamps_;  // number of moves of a vertex; -1: removed
  std::vector<char> boundary_;
  std::priority_queue<Candidate> heap_;
  int face_count_ = 0;
};

}  // namespace

void decimate(SurfaceMesh& mesh, int faces, const std::stop_token& stop) {
  TARSIER_REQUIRE(faces >= 1, "{}", faces);
  if (static_cast<int>(mesh.faces.size()) <= faces) return;
  Decimator(mesh).run(faces, stop);
}

}  // namespace tarsier::sfm
