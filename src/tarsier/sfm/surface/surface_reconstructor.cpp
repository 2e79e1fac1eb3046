// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/surface_reconstructor.h"

#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/surface/decimation.h"
#include "tarsier/sfm/surface/extraction.h"
#include "tarsier/sfm/surface/refinement.h"
#include "tarsier/sfm/surface/view_scan.h"

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>

namespace tarsier::sfm {
namespace {

constexpr double kSmallHole = 6;  // voxels, max diameter of holes that are always closed
// voxels, max distance of a vertex behind the surface's depth in an image
constexpr double kTolerance = 1.5;
constexpr std::size_t kMaxReportedHoles = 20;  // in the report

// Measures the times of the stages.
class Stages {
 public:
  explicit Stages(SurfaceResult& result) : result_(result) {}
  void end(const char* name) {
    const auto now = std::chrono::steady_clock::now();
    result_.seconds.emplace_back(name, std::chrono::duration<double>(now - last_).count());
    last_ = now;
  }

 private:
  SurfaceResult& result_;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace

void SurfaceOptions::check() const {
  check_fields(*this);
  volume.check();
  TARSIER_REQUIRE(texture == 0 || texture >= 64, "texture {}: expected 0, or 64..16384", texture);
}

SurfaceReconstructor::SurfaceReconstructor(const SurfaceOptions& options) : options_(options) {
  options_.check();
}

void SurfaceReconstructor::make_mesh(const Workspace& workspace, Progress& progress,
                                     const std::stop_token& stop, SurfaceResult& result) const {
  Stages stages(result);
  SurfaceMesh& mesh = result.surface.mesh;
  {
    const FusedVolume fused = fuse_depth_maps(workspace, options_.volume, progress, stop);
    stages.end("fuse");
    result.voxel = fused.volume.size();
    result.views = fused.views;
    result.views_without = fused.views_without;
    result.coarser = fused.coarser;
    mesh = extract_surface(fused.volume, options_.volume.truncation);
  }
  throw_if_stopped(stop);
  result.parts_removed = remove_small_parts(mesh, options_.min_part);
  result.faces_extracted = static_cast<std::int64_t>(mesh.faces.size());
  result.holes_closed = close_holes(mesh, kSmallHole * result.voxel);
  stages.end("extract");
  throw_if_stopped(stop);
  smooth_surface(mesh, options_.smoothing);
  stages.end("smooth");
  if (options_.close_holes > 0) {
    throw_if_stopped(stop);
    const double extent = measure_surface(mesh).diagonal();
    // The outer boundary of a relief may be as wide as the relief, except for rounding.
    result.holes_closed += close_holes(mesh, 1.001 * options_.close_holes * extent);
    stages.end("close holes");
  }
  if (options_.faces > 0) decimate(mesh, options_.faces, stop);
  stages.end("decimate");
}

void SurfaceReconstructor::paint(const Workspace& workspace, Progress& progress,
                                 const std::stop_token& stop, SurfaceResult& result) const {
  Stages stages(result);
  SurfaceMesh& mesh = result.surface.mesh;
  const ViewScan scan = scan_views(workspace, mesh, kTolerance * result.voxel,
                                   options_.volume.dark_level, progress, stop);
  mesh.colors = scan.colors;
  result.unseen_faces = scan.unseen_faces;
  stages.end("views");
  if (options_.texture == 0) return;
  throw_if_stopped(stop);
  const std::vector<int> views = choose_views(mesh, scan, workspace.count());
  stages.end("choose");
  result.surface.texture = make_surface_texture(
      {workspace, mesh, views, options_.texture, options_.level_seams}, progress, stop);
  stages.end("texture");
}

SurfaceResult SurfaceReconstructor::run(const Workspace& workspace, Progress& progress,
                                        const std::stop_token& stop) const {
  check_coordinates(workspace.sparse());
  SurfaceResult result;
  make_mesh(workspace, progress, stop, result);
  SurfaceMesh& mesh = result.surface.mesh;
  if (!mesh.faces.empty()) paint(workspace, progress, stop, result);
  for (Eigen::Vector3f& v : mesh.vertices) v *= static_cast<float>(options_.scale);
  result.voxel *= options_.scale;
  result.measures = measure_surface(mesh);
  result.holes = boundary_loops(mesh);
  return result;
}

nlohmann::ordered_json to_json(const SurfaceResult& result) {
  nlohmann::ordered_json json{{"views", result.views},
                              {"views_without", result.views_without},
                              {"voxel", result.voxel},
                              {"coarser", result.coarser},
                              {"faces_extracted", result.faces_extracted},
                              {"parts_removed", result.parts_removed},
                              {"holes_closed", result.holes_closed}};
  json.update(to_json(result.measures));
  nlohmann::ordered_json holes = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < std::min(kMaxReportedHoles, result.holes.size()); ++i) {
    const BoundaryLoop& hole = result.holes[i];
    holes.push_back({{"length", hole.length},
                     {"diameter", hole.diameter},
                     {"center", {hole.center[0], hole.center[1], hole.center[2]}}});
  }
  json["largest_holes"] = std::move(holes);
  json["unseen_faces"] = result.unseen_faces;
  json["texture"] = nullptr;
  if (const auto& texture = result.surface.texture) {
    json["texture"] = {{"width", texture->image.cols},
                       {"height", texture->image.rows},
                       {"charts", texture->charts},
                       {"scale", texture->scale}};
  }
  nlohmann::ordered_json seconds = nlohmann::ordered_json::object();
  for (const auto& [stage, time] : result.seconds) seconds[stage] = time;
  json["seconds"] = std::move(seconds);
  return json;
}

}  // namespace tarsier::sfm
