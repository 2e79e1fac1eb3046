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

// Draws meshes into an image, without a graphics card: z-buffer over triangles,
// perspective-correct (Blinn, "Hyperbolic interpolation", 1992), rasterised with half-plane
// functions (Pineda 1988) on a grid of 1/256 px with the top-left rule, so that triangles which
// share an edge neither overlap nor leave gaps. The camera's distortion is applied to the vertices;
// edges between them stay straight.
namespace tarsier::render {

// One light that comes from far away, and light from everywhere:
//   colour = base * (ambient + diffuse max(0, n . l)) + specular max(0, n . h)^shininess * 255,
// n the normal, l towards the light, h halfway between l and the eye (Blinn 1977), in the image's
// own (not linear) values; clipped at 255.
struct Light {
  Eigen::Vector3d direction{0.3, 0.5,
                            1};  // in which the light flies, in the camera's frame (x right, y
                                 // down, z forward), of any length > 0
  double ambient = 0.4;          // all >= 0
  double diffuse = 0.65;
  double specular = 0;
  double shininess = 30;
};

enum class Shading {
  kGouraud,  // lit at the corners: fast
  kPhong,    // normals interpolated: highlights
};

enum class Role {
  kSolid,     // is seen
  kOccluder,  // is not seen itself but hides what is behind it: the real head or table
  kShadow,    // darkens the image once where it lies, behind all solids (see planar_shadow)
};

struct Item {
  std::shared_ptr<const Mesh> mesh;
  geometry::Rigid3 camera_from_mesh;
  double scale = 1;  // of the mesh's positions, before the rigid motion; > 0
  Role role = Role::kSolid;
  bool back_faces = true;  // false: triangles seen from behind are left out; true: they are lit
                           // from the side that is seen
};

struct Scene {
  std::vector<Item> items;
  Light light;
  Shading shading = Shading::kGouraud;
  bool antialias = false;  // four samples a pixel
  double near = 1e-3;      // what is nearer to the camera is cut off; > 0, unit of the poses
  double darkness = 0.45;  // of shadows, 0..1
  void check() const;      // throws std::invalid_argument; checks the meshes' indices too
};

// Draws the scene over `bgr` (CV_8UC3, at most 16384 px a side; of the camera's size or a crop that
// begins at its origin). The same for any number of threads. At the same depth the earlier item
// wins. Throws std::invalid_argument.
void render(cv::Mat& bgr, const Scene& scene, const geometry::Camera& camera);

// The shadow of a mesh on the plane z = 0, in the plane's frame (z up, towards the viewer), of the
// parts with z > 0: each point moved along `light_in_plane` (in which the light flies, z < 0) to
// z = 0. Draw it with Role::kShadow and the pose camera_from_plane. Throws std::invalid_argument
// for light that does not come from above.
[[nodiscard]] Mesh planar_shadow(const Mesh& mesh, const geometry::Rigid3& plane_from_mesh,
                                 double scale, const Eigen::Vector3d& light_in_plane);

}  // namespace tarsier::render
