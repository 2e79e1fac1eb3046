// SPDX-License-Identifier: MIT
#include "tarsier/core/rng.h"
#include "tarsier/render/builtin.h"
#include "tarsier/render/render.h"

#include <fmt/format.h>

#include "bench.h"
#include "framework/stopwatch.h"
#include <memory>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

// A sphere of 10 200 triangles that fills most of the image, with or without a texture.
std::shared_ptr<const render::Mesh> ball(bool textured, std::uint64_t seed) {
  render::Mesh mesh = render::make_sphere(51, {0.9F, 0.8F, 0.7F});
  if (textured) {
    cv::Mat image(256, 256, CV_8UC3);
    Rng rng(seed);
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < 3 * image.cols; ++x) {
        image.ptr<std::uint8_t>(y)[x] = static_cast<std::uint8_t>(rng.integer(0, 255));
      }
    }
    mesh.textures.push_back(render::make_texture(image));
    mesh.materials[0].texture = 0;
    for (const cv::Vec3f& p : mesh.positions) mesh.uvs.emplace_back(p[0], p[2]);
    for (render::Triangle& triangle : mesh.triangles) triangle.uv = triangle.position;
  }
  return std::make_shared<const render::Mesh>(std::move(mesh));
}

}  // namespace

ExitStatus bench_render(Context& context, const BenchOptions& options) {
  geometry::Camera camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 640;
  camera.cx = 319.5;
  camera.cy = 239.5;
  for (const char* name : {"gouraud", "gouraud-texture", "phong", "gouraud-antialias"}) {
    const std::string_view what = name;
    if (!is_chosen(options, what)) continue;
    render::Scene scene;
    scene.shading = what == "phong" ? render::Shading::kPhong : render::Shading::kGouraud;
    scene.light.specular = 0.3;
    scene.antialias = what == "gouraud-antialias";
    render::Item item;
    item.mesh = ball(what == "gouraud-texture", context.seed);
    item.camera_from_mesh.translation = {0, 0, 3.2};
    scene.items = {item};
    cv::Mat image(camera.height, camera.width, CV_8UC3);
    const double ms = median_ms(options.repeats, [&] {
      image.setTo(cv::Scalar::all(80));
      render::render(image, scene, camera);
    });
    if (context.json) {
      print_json(nlohmann::ordered_json{{"bench", "render"},
                                        {"case", name},
                                        {"triangles", item.mesh->triangles.size()},
                                        {"size", "640x480"},
                                        {"ms", rounded(ms, 2)}});
    } else {
      print_text(fmt::format("{:>18}  {} triangles  640x480  {:6.2f} ms\n", name,
                             item.mesh->triangles.size(), ms));
    }
  }
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
