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

// Objects that stand on printed sheets: drawn over the image, lit, with their shadow on the sheet,
// hidden by the sheet and by each other where they are behind.
namespace tarsier::planar::augment {

enum class Object { kNone, kAxes, kCube, kMesh };
// "none", "axes", "cube", "mesh"; nothing for other names.
[[nodiscard]] std::optional<Object> object_named(std::string_view name);
[[nodiscard]] std::string_view name_of(Object object);

enum class Up { kY, kZ };  // which axis of a mesh is its height; Wavefront files mostly mean y

// The mesh as it stands on a sheet of side 1 whose frame has its origin in the middle and z out of
// the sheet: upright, its lowest point on z = 0, its footprint in the middle, so large that the
// footprint's longer side is 1 or the height 1.5, whichever is less. Throws std::invalid_argument
// for a mesh without triangles or without extent.
[[nodiscard]] render::Mesh standing(const render::Mesh& mesh, Up up = Up::kY);

struct AugmentOptions {
  Object object = Object::kCube;
  std::shared_ptr<const render::Mesh> mesh;  // for kMesh, from standing()
  double scale = 1;                          // of the object, by the sheet's side
  bool shadow = true;
  bool antialias = true;

  [[nodiscard]] OptionFields fields() {
    return {{"scale", scale, range(0.01, 100), "--scale",
             "of cube, axes or mesh, by the marker's side"}};
  }
  void check() const;  // throws std::invalid_argument
};

// A sheet that is seen: origin in its middle, x right, y up, z out of it.
struct Sheet {
  int key = 0;  // tells sheets apart from frame to frame
  geometry::Rigid3 camera_from_sheet;
  double side = 0;  // m, > 0
};

// The light stays where it is in the world while the camera moves: it belongs to one of the sheets,
// and goes over to another when that is out of sight.
struct AugmentState {
  std::optional<int> anchor;
  Eigen::Vector3d light_in_anchor{0.45, -0.6, -1};  // in which it flies
  Eigen::Vector3d light_in_camera{0, 0, 1};
};

// Draws the object on every sheet over `bgr` (CV_8UC3, of the camera's size). Sheets are in any
// order; the image does not depend on it, but for objects that touch.
void augment(cv::Mat& bgr, const geometry::Camera& camera, std::span<const Sheet> sheets,
             const AugmentOptions& options, AugmentState& state);

}  // namespace tarsier::planar::augment
