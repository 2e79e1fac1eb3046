// SPDX-License-Identifier: MIT
// sfm_mesh DENSE SURFACE: writes the textured surface of a dense folder (.glb, .obj or .ply).
//   sfm_mesh dense mesh.glb
//   sfm_mesh drawn mesh.glb    (four images and depth maps of a synthetic scene)
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/surface/surface_reconstructor.h"
#include "tarsier/synth/sfm_scene.h"

#include <cstdio>
#include <exception>
#include <filesystem>

void draw(const std::string& folder) {
  const tarsier::synth::SfmScene scene({.size = {120, 90}, .images = 4});
  tarsier::sfm::Model model{.cameras = {scene.camera()}, .images = {}, .points = {}};
  for (int i = 0; i < scene.count(); ++i)
    model.images.push_back({std::to_string(i) + ".png", 0, true, scene.pose(i), {}, {}, {}});
  tarsier::sfm::write_colmap(folder + "/sparse", model);
  std::filesystem::create_directories(folder + "/images");
  const auto workspace = tarsier::sfm::Workspace::open(folder);
  for (int i = 0; i < scene.count(); ++i) {
    tarsier::write_image(workspace.path_of_image(i), scene.render(i));
    cv::Mat1f depth(90, 120);
    for (int p = 0; p < depth.cols * depth.rows; ++p)
      depth(p / 120, p % 120) = float(scene.depth(i, cv::Point2d(p % 120, p / 120)).value_or(0));
    workspace.write_depth_map(i, {depth, {}, {}});
  }
}

int main(int argc, char** argv) try {
  if (std::string(argc > 2 ? argv[1] : "") == "drawn") draw(argv[1]);
  tarsier::NoProgress progress;
  const auto result = tarsier::sfm::SurfaceReconstructor({}).run(
      tarsier::sfm::Workspace::open(argc > 2 ? argv[1] : "dense"), progress, {});
  tarsier::sfm::write_surface(argc > 2 ? argv[2] : "mesh.glb", result.surface);
  std::printf("%d faces, area %.2f\n", int(result.measures.faces), result.measures.area);
} catch (const std::exception& error) {
  return std::fprintf(stderr, "sfm_mesh: %s\n", error.what()), 1;
}
