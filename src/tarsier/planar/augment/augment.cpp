// SPDX-License-Identifier: MIT
#include "tarsier/planar/augment/augment.h"

#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"
#include "tarsier/render/builtin.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace tarsier::planar::augment {
namespace {

using render::Mesh;

constexpr NameTable<Object, 4> kObjects{"object",
                                        {{{Object::kNone, "none"},
                                          {Object::kAxes, "axes"},
                                          {Object::kCube, "cube"},
                                          {Object::kMesh, "mesh"}}}};

// The sheet itself, which occludes what is below it. It lies slightly below the shadow on it.
constexpr double kDeeper = 0.004;  // relative to the side
constexpr double kRim = 0.2;       // relative to the side: margin of the sheet around the print
// Light that grazes the sheet casts no visible shadow.
constexpr double kSteep = 0.1;

std::shared_ptr<const Mesh> builtin(Object object) {
  static const auto axes = std::make_shared<const Mesh>(render::make_axes());
  static const auto cube = [] {
    Mesh mesh = render::make_cube();
    for (cv::Vec3f& p : mesh.positions) p[2] += 0.5F;
    return std::make_shared<const Mesh>(std::move(mesh));
  }();
  return object == Object::kAxes ? axes : cube;
}

// A rectangle below the sheet and the object on it.
Mesh ground_of(const Mesh& object, double scale) {
  const render::Bounds box = render::bounds_of(object);
  const auto size = static_cast<float>(scale);
  const auto rim = static_cast<float>(0.5 + kRim);
  const float left = std::min(-rim, box.low[0] * size);
  const float right = std::max(rim, box.high[0] * size);
  const float near = std::min(-rim, box.low[1] * size);
  const float far = std::max(rim, box.high[1] * size);
  const auto z = static_cast<float>(-kDeeper);
  Mesh ground;
  ground.positions = {{left, near, z}, {right, near, z}, {right, far, z}, {left, far, z}};
  render::Triangle triangle;
  triangle.position = {0, 1, 2};
  ground.triangles.push_back(triangle);
  triangle.position = {0, 2, 3};
  ground.triangles.push_back(triangle);
  return ground;
}

// Direction of the light in the camera's frame.
Eigen::Vector3d light_of(std::span<const Sheet> sheets, AugmentState& state) {
  const auto anchor = std::find_if(sheets.begin(), sheets.end(), [&](const Sheet& sheet) {
    return state.anchor && sheet.key == *state.anchor;
  });
  if (anchor == sheets.end()) {
    const Sheet& sheet = *std::min_element(
        sheets.begin(), sheets.end(), [](const Sheet& a, const Sheet& b) { return a.key < b.key; });
    // Keeps its last direction in the camera's frame, if it comes from above this sheet.
    if (state.anchor) {
      const Eigen::Vector3d light =
          sheet.camera_from_sheet.rotation.transpose() * state.light_in_camera;
      if (light[2] < -0.5 * light.norm()) state.light_in_anchor = light;
    }
    state.anchor = sheet.key;
    state.light_in_camera = sheet.camera_from_sheet.rotation * state.light_in_anchor;
  } else {
    state.light_in_camera = anchor->camera_from_sheet.rotation * state.light_in_anchor;
  }
  return state.light_in_camera;
}

}  // namespace

std::optional<Object> object_named(std::string_view name) { return kObjects.find(name); }

std::string_view name_of(Object object) { return kObjects.name(object); }

Mesh upright_mesh(const Mesh& mesh, Up up) {
  mesh.check();
  Mesh turned = mesh;
  if (up == Up::kY) {
    const auto upright = [](cv::Vec3f& v) { v = {v[0], -v[2], v[1]}; };
    std::for_each(turned.positions.begin(), turned.positions.end(), upright);
    std::for_each(turned.normals.begin(), turned.normals.end(), upright);
  }
  const render::Bounds box = render::bounds_of(turned);
  const cv::Vec3f extent = box.high - box.low;
  const float footprint = std::max(extent[0], extent[1]);
  TARSIER_REQUIRE(std::max(footprint, extent[2]) > 0, "a mesh without extent");
  float scale = footprint > 0 ? 1 / footprint : 1.5F / extent[2];
  if (extent[2] * scale > 1.5F) scale = 1.5F / extent[2];
  TARSIER_REQUIRE(std::isfinite(scale), "a mesh of extent {}", footprint);
  const cv::Vec3f foot(0.5F * (box.low[0] + box.high[0]), 0.5F * (box.low[1] + box.high[1]),
                       box.low[2]);
  for (cv::Vec3f& p : turned.positions) p = (p - foot) * scale;
  return turned;
}

void AugmentOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(object != Object::kMesh || mesh != nullptr, "no mesh");
}

void augment(cv::Mat& bgr, const geometry::Camera& camera, std::span<const Sheet> sheets,
             const AugmentOptions& options, AugmentState& state) {
  options.check();
  if (sheets.empty() || options.object == Object::kNone) return;
  const std::shared_ptr<const Mesh> mesh =
      options.object == Object::kMesh ? options.mesh : builtin(options.object);
  const auto ground = std::make_shared<const Mesh>(ground_of(*mesh, options.scale));
  render::Scene scene;
  scene.antialias = options.antialias;
  scene.light.direction = light_of(sheets, state);
  scene.light.specular = 0.15;
  for (const Sheet& sheet : sheets) {
    TARSIER_REQUIRE(sheet.side > 0 && std::isfinite(sheet.side), "a sheet {} m wide", sheet.side);
    const double scale = options.scale * sheet.side;
    render::Item item;
    item.mesh = mesh;
    item.camera_from_mesh = sheet.camera_from_sheet;
    item.scale = scale;
    scene.items.push_back(item);
    item.mesh = ground;
    item.scale = sheet.side;
    item.role = render::Role::kOccluder;
    scene.items.push_back(item);
    if (!options.shadow) continue;
    const Eigen::Vector3d light =
        sheet.camera_from_sheet.rotation.transpose() * scene.light.direction;
    if (light[2] > -kSteep * light.norm()) continue;
    Mesh shadow = render::planar_shadow(*mesh, {}, scale, light);
    if (shadow.triangles.empty()) continue;
    item.mesh = std::make_shared<const Mesh>(std::move(shadow));
    item.scale = 1;
    item.role = render::Role::kShadow;
    scene.items.push_back(std::move(item));
  }
  // Near plane: close to the lens; sheets are in metres.
  scene.near = 1e-3;
  render::render(bgr, scene, camera);
}

}  // namespace tarsier::planar::augment
