// SPDX-License-Identifier: MIT
#include "tarsier/core/at.h"
#include "tarsier/core/require.h"
#include "tarsier/sfm/surface/view_scan.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <map>

namespace tarsier::sfm {
namespace {

constexpr float kMinRelativeQuality = 0.7F;  // share of the best quality
constexpr float kSeamCost = 0.35F;           // cost of a neighbour with another view
constexpr int kMaxSweeps = 10;
constexpr std::size_t kMinPartFaces = 24;  // smaller parts join another
constexpr int kMergeRounds = 3;

float quality_in(const FaceViews& views, int view) {
  for (const FaceView& one : views)
    if (one.view == view) return one.quality;
  return 0;
}

float area_of(const SurfaceMesh& mesh, const Face& face) {
  const Eigen::Vector3f& a = mesh.vertices[at(face[0])];
  return 0.5F * (mesh.vertices[at(face[1])] - a).cross(mesh.vertices[at(face[2])] - a).norm();
}

// Assigns views greedily: next the one that shows most of the rest.
std::vector<int> assign_greedily(const SurfaceMesh& mesh, const ViewScan& scan, int views) {
  std::vector<std::vector<int>> faces_of(at(views));  // faces that a view shows well
  std::vector<double> gains(at(views), 0);
  std::vector<float> areas(mesh.faces.size());
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    areas[f] = area_of(mesh, mesh.faces[f]);
    for (const FaceView& one : scan.faces[f]) {
      if (one.view < 0 || one.quality < kMinRelativeQuality * scan.faces[f][0].quality) continue;
      faces_of[at(one.view)].push_back(static_cast<int>(f));
      gains[at(one.view)] += static_cast<double>(areas[f]);
    }
  }
  std::vector<int> labels(mesh.faces.size(), -1);
  for (int round = 0; round < views; ++round) {
    const auto best = std::max_element(gains.begin(), gains.end());
    if (!(*best > 0)) break;
    const int view = static_cast<int>(best - gains.begin());
    for (const int f : faces_of[at(view)]) {
      if (labels[at(f)] >= 0) continue;
      labels[at(f)] = view;
      for (const FaceView& one : scan.faces[at(f)]) {
        if (one.view >= 0 && one.quality >= kMinRelativeQuality * scan.faces[at(f)][0].quality)
          gains[at(one.view)] -= static_cast<double>(areas[at(f)]);
      }
    }
    gains[at(view)] = -1;
  }
  // Faces left over by rounding of the gains.
  for (std::size_t f = 0; f < labels.size(); ++f)
    if (labels[f] < 0) labels[f] = scan.faces[f][0].view;
  return labels;
}

void minimise_seams(const ViewScan& scan, const std::vector<Face>& neighbors,
                    std::vector<int>& labels) {
  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    int changes = 0;
    for (std::size_t f = 0; f < labels.size(); ++f) {
      if (labels[f] < 0) continue;
      const auto cost_of = [&](int view) {
        float cost = 1 - quality_in(scan.faces[f], view) / scan.faces[f][0].quality;
        for (const int other : neighbors[f])
          if (other >= 0 && labels[at(other)] >= 0 && labels[at(other)] != view) cost += kSeamCost;
        return cost;
      };
      int best = labels[f];
      float min_cost = cost_of(best);
      for (const int other : neighbors[f]) {
        if (other < 0 || labels[at(other)] < 0) continue;
        const int view = labels[at(other)];
        if (view == best || !(quality_in(scan.faces[f], view) > 0)) continue;
        const float cost = cost_of(view);
        if (cost < min_cost) {
          min_cost = cost;
          best = view;
        }
      }
      if (best != labels[f]) {
        labels[f] = best;
        ++changes;
      }
    }
    if (changes == 0) return;
  }
}

// Small parts take the adjacent view with most common edges that shows all of their faces.
void merge_small_parts(const ViewScan& scan, const std::vector<Face>& neighbors,
                       std::vector<int>& labels) {
  std::vector<char> seen(labels.size(), 0);
  for (std::size_t start = 0; start < labels.size(); ++start) {
    if (seen[start] != 0 || labels[start] < 0) continue;
    std::vector<int> part{static_cast<int>(start)};
    seen[start] = 1;
    std::map<int, int> adjacent_views;  // adjacent views, with the number of edges
    for (std::size_t i = 0; i < part.size(); ++i) {
      for (const int other : neighbors[at(part[i])]) {
        if (other < 0 || labels[at(other)] < 0) continue;
        if (labels[at(other)] != labels[start]) {
          ++adjacent_views[labels[at(other)]];
        } else if (seen[at(other)] == 0) {
          seen[at(other)] = 1;
          part.push_back(other);
        }
      }
    }
    if (part.size() >= kMinPartFaces) continue;
    int best = -1;
    int edges = 0;
    for (const auto& [view, count] : adjacent_views) {
      const bool shows_all = std::all_of(part.begin(), part.end(), [&, candidate = view](int f) {
        return quality_in(scan.faces[at(f)], candidate) > 0.3F * scan.faces[at(f)][0].quality;
      });
      if (shows_all && count > edges) {
        best = view;
        edges = count;
      }
    }
    if (best < 0) continue;
    for (const int f : part) labels[at(f)] = best;
  }
}

}  // namespace

std::vector<int> choose_views(const SurfaceMesh& mesh, const ViewScan& scan, int views) {
  TARSIER_REQUIRE(scan.faces.size() == mesh.faces.size(), "{} of {} faces", scan.faces.size(),
                  mesh.faces.size());
  std::vector<int> labels = assign_greedily(mesh, scan, views);
  const std::vector<Face> neighbors = face_neighbors(mesh);
  minimise_seams(scan, neighbors, labels);
  for (int round = 0; round < kMergeRounds; ++round) merge_small_parts(scan, neighbors, labels);
  return labels;
}

}  // namespace tarsier::sfm
