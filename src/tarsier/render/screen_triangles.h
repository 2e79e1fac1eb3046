// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/render/render.h"

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <vector>

// Internals of render(): converts meshes to triangles on the image's grid.
namespace tarsier::render {

inline constexpr int kGrid = 256;      // grid steps per px
inline constexpr int kAttributes = 5;  // Gouraud: light, highlight, 0; Phong: normal; both: u, v

// value + along_x (x - x0) + along_y (y - y0), in px
struct Plane {
  float value = 0;
  float along_x = 0;
  float along_y = 0;
};

struct ScreenTriangle {
  std::array<int, 3> x{};  // 1/256 px; positive area in (x right, y down)
  std::array<int, 3> y{};
  double origin_x = 0;  // px, origin of the planes: the first corner
  double origin_y = 0;
  double inverse_depth = 0;  // 1 / z is linear in the image, and so are attributes / z
  double inverse_along_x = 0;
  double inverse_along_y = 0;
  std::array<Plane, kAttributes> attributes;
  cv::Vec3f color;                   // 0..255
  const Texture* texture = nullptr;  // owned by the scene
  int level = 0;                     // of the texture
};

// Projects points of the camera's frame. Beyond the angle at which the distortion stops being
// invertible (where the polynomial would fold the image back) it is continued linearly.
class Projector {
 public:
  explicit Projector(const geometry::Camera& camera);
  [[nodiscard]] cv::Point2d operator()(const Eigen::Vector3d& in_camera) const;  // z > 0

 private:
  geometry::Camera camera_;
  double largest_radius_ = 0;  // of normalised points
};

// The triangles of an item that may be visible in an image of this size, in the mesh's order.
[[nodiscard]] std::vector<ScreenTriangle> screen_triangles(const Item& item, const Scene& scene,
                                                           const Projector& project,
                                                           const cv::Size& image);

}  // namespace tarsier::render
