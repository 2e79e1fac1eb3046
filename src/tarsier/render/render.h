// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/render/mesh.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/matx.hpp>

#include <memory>
#include <vector>

// Software rendering of meshes into an image. Triangles are drawn with a z-buffer,
// perspective-correct (Blinn, "Hyperbolic interpolation", 1992). They are rasterised with
// half-plane functions (Pineda 1988) on a grid of 1/256 px with the top-left rule, so triangles
// with a common edge neither overlap nor leave gaps. The camera's distortion is applied to the
// vertices; edges between them stay straight.
namespace tarsier::render {

// A directional light and ambient light:
//    colour = base * (ambient + diffuse max(0, n . l)) + specular max(0, n . h)^shininess * 255,
// with n the normal, l the direction to the light, h halfway between l and the eye (Blinn 1977). It
// is computed on the image's gamma-encoded values and clipped at 255.
struct Light {
  // Direction in which the light travels, in the camera's frame (x right, y down, z forward), of
  // any length > 0.
  Eigen::Vector3d direction{0.3, 0.5, 1};
  double ambient = 0.4;  // all >= 0
  double diffuse = 0.65;
  double specular = 0;
  double shininess = 30;
};

enum class Shading {
  kGouraud,  // lit at the vertices: fast
  kPhong,    // normals interpolated: highlights
};

enum class Role {
  kSolid,     // visible
  kOccluder,  // invisible, but hides objects behind it: the real head or table
  kShadow,    // darkens the image once, behind all solids (see planar_shadow)
};

struct Item {
  std::shared_ptr<const Mesh> mesh;
  geometry::Rigid3 camera_from_mesh;
  double scale = 1;  // of the mesh's positions, before the rigid motion; > 0
  Role role = Role::kSolid;
  // False: triangles seen from behind are not drawn. True: they are lit from the visible side.
  bool back_faces = true;
};

struct Scene {
  std::vector<Item> items;
  Light light;
  Shading shading = Shading::kGouraud;
  bool antialias = false;  // four samples per pixel
  double near = 1e-3;      // near plane; > 0, unit of the poses
  double darkness = 0.45;  // of shadows, 0..1
  void check() const;      // throws std::invalid_argument; checks the meshes' indices too
};

// Draws the scene over `bgr` (CV_8UC3, at most 16384 px a side; of the camera's size, or a crop
// that begins at its origin). The result does not depend on the number of threads. At equal depth
// the earlier item is drawn. Throws std::invalid_argument.
void render(cv::Mat& bgr, const Scene& scene, const geometry::Camera& camera);

// The shadow of a mesh on the plane z = 0, in the plane's frame (z up, towards the viewer), from
// the parts with z > 0. Each point is projected along `light_in_plane` (the direction in which
// light travels, z < 0) to z = 0. Draw it with Role::kShadow and the pose camera_from_plane. Throws
// std::invalid_argument if the light does not come from above.
[[nodiscard]] Mesh planar_shadow(const Mesh& mesh, const geometry::Rigid3& plane_from_mesh,
                                 double scale, const Eigen::Vector3d& light_in_plane);

}  // namespace tarsier::render
