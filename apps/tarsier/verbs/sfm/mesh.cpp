// SPDX-License-Identifier: MIT
#include "verbs/sfm/mesh.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/file_extension.h"
#include "tarsier/core/log.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/pipelines/placement.h"
#include "tarsier/sfm/surface/surface_page.h"
#include "tarsier/sfm/surface/surface_view.h"
#include "tarsier/sfm/view/animation.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "verbs/sfm/memory_flag.h"
#include "verbs/sfm/scale_flags.h"
#include "verbs/sfm/sfm.h"
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;

struct MeshVerbFlags {
  std::string dense;
  ScaleFlags scale;
  MeshFlags mesh;
};

// Detects before the work what would otherwise fail after it.
void check_output(const std::string& path) {
  std::error_code ignored;
  if (fs::exists(path, ignored) && !fs::is_regular_file(path, ignored)) return;
  const AtomicFile writable(path);
}

// Scales the model to the unit of the flags. Returns the new units per unit of the model.
double scaled(const ScaleFlags& flags, const sfm::Workspace& workspace, Context& context,
              sfm::Model& model) {
  sfm::PlacementOptions options;
  set_scale(flags, options);
  const auto index_of = [&](const std::string& name) {
    for (int i = 0; i < workspace.count(); ++i)
      if (workspace.name(i) == name) return i;
    throw UsageError(
        fmt::format("--distance-between: no image '{}' in {}", name, workspace.folder()));
  };
  for (const std::string& name : flags.distance_between) (void)index_of(name);
  std::optional<sfm::MarkerScale> markers;
  if (options.markers) {
    const auto path_of = [&](const std::string& name) {
      return workspace.path_of_image(index_of(name));
    };
    markers = sfm::marker_scale(model, path_of, *options.markers, *context.progress, context.stop);
  }
  return sfm::place(model, options, {}, context.seed, markers).scale.value_or(1);
}

std::string summary_text(const sfm::SurfaceResult& result) {
  const sfm::SurfaceMeasures& m = result.measures;
  const Eigen::Vector3d extent = m.high - m.low;
  std::string text = fmt::format(
      "{} faces, {} vertices, {} part{} (voxels of {:.4g}, {} of {} images with depth)\n", m.faces,
      m.vertices, m.parts, m.parts == 1 ? "" : "s", result.voxel, result.views,
      result.views + result.views_without);
  text += fmt::format("extent {:.4g} x {:.4g} x {:.4g}, area {:.5g}, ", extent[0], extent[1],
                      extent[2], m.area);
  text += m.volume ? fmt::format("closed: volume {:.5g}\n", std::abs(*m.volume))
                   : fmt::format("open: {} hole{}, total boundary length {:.4g}\n", m.holes,
                                 m.holes == 1 ? "" : "s", m.hole_length);
  if (const auto& texture = result.surface.texture)
    text +=
        fmt::format("texture {}x{}, {} charts, at {:.3g} of the full resolution of the images\n",
                    texture->image.cols, texture->image.rows, texture->charts, texture->scale);
  return text;
}

ExitStatus make_mesh(MeshVerbFlags& flags, Context& context) {
  sfm::SurfaceOptions options = options_of(flags.mesh);
  const sfm::Workspace workspace = sfm::Workspace::open(flags.dense);
  sfm::Model model = workspace.sparse();
  options.scale = scaled(flags.scale, workspace, context, model);
  return run_mesh(flags.mesh, options, {workspace, model}, context);
}

void add_flags(Command& verb, MeshVerbFlags& flags) {
  MeshFlags& mesh = flags.mesh;
  verb.add_option("DENSE", flags.dense, "output folder of `sfm dense`, or COLMAP's dense workspace")
      .required()
      .type_name("");
  verb.add_option("-o,--output", mesh.output,
                  "output mesh: .ply, .obj (with .mtl and .png) or .glb")
      .required();
  bind_field(verb, mesh.options, mesh.options.faces);
  add_field(verb, {"texture", mesh.texture, range(0, 16384), "--texture",
                   "px, longest side of the texture; 0: vertex colours [4096; of .ply: 0]"});
  bind_field(verb, mesh.options.volume, mesh.options.volume.voxel);
  bind_field(verb, mesh.options.volume, mesh.options.volume.trim_px);
  bind_field(verb, mesh.options.volume, mesh.options.volume.dark_level);
  bind_field(verb, mesh.options, mesh.options.close_holes);
  bind_field(verb, mesh.options, mesh.options.smoothing);
  bind_field(verb, mesh.options, mesh.options.min_part);
  verb.add_option("--memory", mesh.memory, "memory limit; voxels are enlarged to stay below")
      .show_default();
  add_scale_flags(verb, flags.scale, "Scale");
  verb.add_option("--view", mesh.view, "image of the mesh: view.png");
  verb.add_option("--turntable", mesh.turntable, "animation of the rotating mesh: mesh.gif");
  verb.add_option("--page", mesh.page,
                  "interactive page for a browser with mesh, cloud and cameras: mesh.html");
}

}  // namespace

sfm::SurfaceOptions options_of(const MeshFlags& flags) {
  sfm::SurfaceOptions options = flags.options;
  const sfm::SurfaceFormat format = sfm::surface_format_of(flags.output);
  options.texture = flags.texture.value_or(format == sfm::SurfaceFormat::kPly ? 0 : 4096);
  if (options.texture != 0 && (options.texture < 64 || options.texture > 16384))
    throw UsageError(fmt::format("--texture {}: expected 0, or 64..16384", options.texture));
  options.volume.memory_gb = parse_memory(flags.memory);
  if (!flags.view.empty() && !is_image_path(flags.view))
    throw UsageError(
        fmt::format("--view '{}': expected .png, .jpg, .webp, .bmp, .ppm", flags.view));
  if (!flags.turntable.empty() && lowercase_extension(flags.turntable) != ".gif")
    throw UsageError(fmt::format("--turntable '{}': expected .gif", flags.turntable));
  if (!flags.page.empty() && lowercase_extension(flags.page) != ".html")
    throw UsageError(fmt::format("--page '{}': expected .html", flags.page));
  for (const std::string& path : sfm::surface_files(flags.output, options.texture > 0))
    check_output(path);
  for (const std::string& path : {flags.view, flags.turntable, flags.page})
    if (!path.empty()) check_output(path);
  return options;
}

ExitStatus run_mesh(const MeshFlags& flags, const sfm::SurfaceOptions& options, const MeshJob& job,
                    Context& context) {
  const sfm::SurfaceResult result =
      sfm::SurfaceReconstructor(options).run(job.workspace, *context.progress, context.stop);
  if (result.coarser)
    log_warning("voxels are enlarged to {:.4g} to stay below --memory {}", result.voxel,
                flags.memory);
  if (context.json)
    print_json(sfm::to_json(result));
  else
    print_text(summary_text(result));
  if (result.surface.mesh.faces.empty()) {
    log_warning("{}: the depth maps contain no surface, and nothing is written: change --voxel",
                job.workspace.folder());
    return ExitStatus::kNothingFound;
  }
  const sfm::Model& model = job.model;
  sfm::write_surface(flags.output, result.surface, sfm::upright_of(result.surface, model));
  sfm::ViewOptions view;
  if (!flags.view.empty())
    write_image(flags.view, sfm::render_surface(result.surface, model, view));
  if (!flags.turntable.empty()) {
    view.size = {640, 480};
    std::vector<cv::Mat> frames;
    sfm::render_surface_turntable(result.surface, model, view, 36, [&](int, const cv::Mat& frame) {
      frames.push_back(frame.clone());
    });
    sfm::write_gif(flags.turntable, frames, 12);
  }
  if (!flags.page.empty()) {
    const std::string cloud = (fs::path(job.workspace.folder()) / "fused.ply").string();
    write_file_atomically(flags.page,
                          sfm::viewer_html(model, fs::path(flags.output).stem().string(),
                                           {sfm::viewer_cloud(cloud, options.scale),
                                            sfm::viewer_surface(result.surface)}));
  }
  log_info("{}: surface written{}", flags.output,
           flags.page.empty() ? "" : "; to see it, open " + flags.page);
  return ExitStatus::kDone;
}

void add_sfm_mesh(Command& sfm, Context& context) {
  add_verb<MeshVerbFlags>(sfm, "mesh", "compute a textured triangle mesh from a dense folder",
                          context, add_flags, make_mesh);
}

}  // namespace tarsier::cli
