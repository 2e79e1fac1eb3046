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
  int faces = 300'000;  // max number of triangles; 0: all
  int smoothing = 3;    // rounds of smoothing
  // max diameter of closed holes, as a share of the surface's extent; 1: all
  double close_holes = 0;
  double min_part = 0.02;   // min size of kept parts, as a share of the largest part's faces
  int texture = 4096;       // px, longest side; 0: vertex colours
  bool level_seams = true;  // level the seams of the texture
  double scale = 1;         // units of the result per unit of the model

  [[nodiscard]] OptionFields fields() {
    return {
        {"faces", faces, at_least(0), "--faces", "maximum number of triangles; 0: all"},
        {"smoothing", smoothing, range(0, 100), "--smoothing", "number of smoothing iterations"},
        {"close_holes", close_holes, range(0, 1), "--close-holes",
         "maximum width of a hole to close, share of the extent; 1: all holes"},
        {"min_part", min_part, range(0, 1), "--min-part",
         "minimum size of a connected part, share of the faces of the largest"},
        {"texture", texture, range(0, 16384)},
        {"scale", scale, above(0)},
    };
  }
  void check() const;  // throws std::invalid_argument, which names the value
};

struct SurfaceResult {
  TexturedSurface surface;
  SurfaceMeasures measures;
  std::vector<BoundaryLoop> holes;  // remaining holes, longest first
  double voxel = 0;                 // side, in units of the result
  bool coarser = false;  // voxels are larger than the depth maps allow, because of the memory limit
  int views = 0;         // views with depth
  int views_without = 0;
  int parts_removed = 0;
  int holes_closed = 0;
  std::int64_t faces_extracted = 0;                     // before decimation
  int unseen_faces = 0;                                 // faces that no image shows completely
  std::vector<std::pair<std::string, double>> seconds;  // per stage
};
// {"views", "views_without", "voxel", "coarser", "faces_extracted", "parts_removed",
// "holes_closed", to_json(SurfaceMeasures), "largest_holes": up to 20 of {"length", "diameter",
// "center"}, "unseen_faces", "texture": {"width", "height", "charts", "scale"} or null, "seconds"}
[[nodiscard]] nlohmann::ordered_json to_json(const SurfaceResult& result);

// Makes a surface from the depth maps of a dense workspace:
//
//   const sfm::SurfaceReconstructor reconstructor(sfm::SurfaceOptions{});
//   NoProgress progress;
//   const sfm::SurfaceResult result = reconstructor.run(sfm::Workspace::open("dense"), progress, {});
//   sfm::write_surface("mesh.glb", result.surface);
//
// The depth maps are fused to a signed distance (depth_fusion.h), whose zero level is the surface
// (extraction.h). Small parts are removed. Holes of up to six voxels, and larger ones by the
// options, are closed. The surface is smoothed and decimated (refinement.h, decimation.h). It gets
// vertex colours from the images (view_scan.h) or a texture (texture.h). The class is const:
// several threads may share an object. The result depends on workspace and options, not on the
// number of threads.
class SurfaceReconstructor {
 public:
  explicit SurfaceReconstructor(const SurfaceOptions& options);  // throws std::invalid_argument
  [[nodiscard]] const SurfaceOptions& options() const { return options_; }

  // Returns a surface without faces where the depth maps show none. Throws as check_coordinates(),
  // fuse_depth_maps() and make_surface_texture().
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
