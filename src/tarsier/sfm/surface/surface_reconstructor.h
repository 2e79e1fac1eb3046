// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/sfm/surface/depth_fusion.h"
#include "tarsier/sfm/surface/surface_files.h"
#include "tarsier/sfm/surface/surface_mesh.h"

#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::sfm {

struct SurfaceOptions {
  VolumeOptions volume;
  int faces = 300'000;      // triangles at most; 0: all
  int smoothing = 3;        // rounds
  double close_holes = 0;   // widest hole to close, of the surface's extent; 1: all
  double min_part = 0.02;   // smallest part to keep, of the faces of the largest
  int texture = 4096;       // px, largest side; 0: colours of vertices
  bool level_seams = true;  // of the texture
  double scale = 1;         // of the result: units for one of the model

  [[nodiscard]] OptionFields fields() {
    return {
        {"faces", faces, at_least(0), "--faces", "triangles at most; 0: all"},
        {"smoothing", smoothing, range(0, 100), "--smoothing", "rounds that take noise away"},
        {"close_holes", close_holes, range(0, 1), "--close-holes",
         "widest hole to close, of the extent; 1: all"},
        {"min_part", min_part, range(0, 1), "--min-part",
         "smallest part to keep, of the faces of the largest"},
        {"texture", texture, range(0, 16384)},
        {"scale", scale, above(0)},
    };
  }
  void check() const;  // throws std::invalid_argument that names the value
};

struct SurfaceResult {
  TexturedSurface surface;
  SurfaceMeasures measures;
  std::vector<BoundaryLoop> holes;  // that are left, longest first
  double voxel = 0;                 // world units (those of `scale`), side
  bool coarser = false;             // voxels are larger than the depth maps, because of the memory
  int views = 0;                    // with depth
  int views_without = 0;
  int parts_removed = 0;
  int holes_closed = 0;
  std::int64_t faces_extracted = 0;                     // before decimation
  int unseen_faces = 0;                                 // that no image shows whole
  std::vector<std::pair<std::string, double>> seconds;  // of each stage
};
// {"views", "views_without", "voxel", "coarser", "faces_extracted", "parts_removed", "holes_closed",
// to_json(SurfaceMeasures), "largest_holes": up to 20 of {"length", "diameter", "center"},
// "unseen_faces", "texture": {"width", "height", "charts", "scale"} or null, "seconds"}
[[nodiscard]] nlohmann::ordered_json to_json(const SurfaceResult& result);

// A surface of the depth maps of a dense workspace:
//
//   const sfm::SurfaceReconstructor reconstructor(sfm::SurfaceOptions{});
//   NoProgress progress;
//   const sfm::SurfaceResult result = reconstructor.run(sfm::Workspace::open("dense"), progress, {});
//   sfm::write_surface("mesh.glb", result.surface);
//
// The depth maps are fused to a signed distance (depth_fusion.h), its zero is the surface
// (extraction.h), small parts go, holes of six voxels and those that options ask for are closed,
// noise is smoothed and faces are collapsed (refinement.h, decimation.h); then colours come from the
// images (view_scan.h), or a texture (texture.h). Const: any number of threads may use it. Same
// workspace and options, same result, for any number of threads.
class SurfaceReconstructor {
 public:
  explicit SurfaceReconstructor(const SurfaceOptions& options);  // throws std::invalid_argument
  [[nodiscard]] const SurfaceOptions& options() const { return options_; }

  // A surface without faces where the depth maps show none. Throws as fuse_depth_maps() and
  // make_surface_texture().
  [[nodiscard]] SurfaceResult run(const Workspace& workspace, Progress& progress,
                                  const std::stop_token& stop) const;

 private:
  void make_mesh(const Workspace& workspace, Progress& progress, const std::stop_token& stop,
                 SurfaceResult& result) const;
  void paint(const Workspace& workspace, Progress& progress, const std::stop_token& stop,
             SurfaceResult& result) const;

  SurfaceOptions options_;
};

}  // namespace tarsier::sfm
