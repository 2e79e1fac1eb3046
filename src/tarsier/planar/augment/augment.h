// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/render/mesh.h"
#include "tarsier/render/render.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <memory>
#include <optional>
#include <span>
#include <string_view>

// Objects that stand on printed sheets. They are drawn over the image with lighting and with their
// shadow on the sheet. The sheet and other objects occlude them.
namespace tarsier::planar::augment {

enum class Object { kNone, kAxes, kCube, kMesh };
// "none", "axes", "cube", "mesh"; empty for other names.
[[nodiscard]] std::optional<Object> object_named(std::string_view name);
[[nodiscard]] std::string_view name_of(Object object);

enum class Up { kY, kZ };  // the axis of a mesh that points up; in Wavefront files mostly y

// Places the mesh on a sheet of side 1 whose frame has its origin in the centre and z out of the
// sheet. The mesh is upright, its lowest point lies on z = 0, and its footprint is centred. It is
// scaled so that the footprint's longer side is 1 or the height is 1.5, whichever is smaller.
// Throws std::invalid_argument for a mesh without triangles or without extent.
[[nodiscard]] render::Mesh upright_mesh(const render::Mesh& mesh, Up up = Up::kY);

struct AugmentOptions {
  Object object = Object::kCube;
  std::shared_ptr<const render::Mesh> mesh;  // for kMesh, from upright_mesh()
  double scale = 1;                          // of the object, relative to the sheet's side
  bool shadow = true;
  bool antialias = true;

  [[nodiscard]] OptionFields fields() {
    return {{"scale", scale, range(0.01, 100), "--scale",
             "size of cube, axes or mesh, in marker sides"}};
  }
  void check() const;  // throws std::invalid_argument
};

// A visible sheet: origin at its centre, x right, y up, z out of it.
struct Sheet {
  int key = 0;  // identifies the sheet from frame to frame
  geometry::Rigid3 camera_from_sheet;
  double side = 0;  // m, > 0
};

// The light is fixed in the world while the camera moves. Its direction is stored relative to one
// sheet, and moves to another sheet when that one is out of view.
struct AugmentState {
  std::optional<int> anchor;
  Eigen::Vector3d light_in_anchor{0.45, -0.6, -1};  // direction of travel
  Eigen::Vector3d light_in_camera{0, 0, 1};
};

// Draws the object on every sheet over `bgr` (CV_8UC3, of the camera's size). The result does not
// depend on the order of the sheets unless objects touch.
void augment(cv::Mat& bgr, const geometry::Camera& camera, std::span<const Sheet> sheets,
             const AugmentOptions& options, AugmentState& state);

}  // namespace tarsier::planar::augment
