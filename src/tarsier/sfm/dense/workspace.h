// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/sfm/dense/depth_map.h"
#include "tarsier/sfm/scene/model.h"

#include <opencv2/core.hpp>

#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::sfm {

// The two kinds of maps of an image, by COLMAP's names.
enum class MapKind {
  kPhotometric,  // as the images alone give it: a depth for nearly every pixel, right or wrong
  kGeometric,    // what the maps of other images agree with
};
[[nodiscard]] std::string_view name_of(MapKind kind);  // "photometric", "geometric"

// A folder of dense reconstruction, in the layout of COLMAP's dense workspace:
//
//   images/NAME                                     undistorted images
//   sparse/{cameras,images,points3D}.txt            pinhole cameras, poses, points
//   stereo/depth_maps/NAME.{photometric,geometric}.bin
//   stereo/normal_maps/NAME.{photometric,geometric}.bin
//   stereo/confidence/NAME.bin, NAME.photometric.bin     ours
//
// Const: the model is in memory, images and maps are read when they are asked for. Any number of
// threads may read; one may write a map at a time. Indices outside 0..count()-1 throw
// std::invalid_argument.
class Workspace {
 public:
  // Reads the model. Throws InputError that says what is missing, or that a camera is distorted.
  [[nodiscard]] static Workspace open(const std::string& folder);

  [[nodiscard]] const std::string& folder() const { return folder_; }
  [[nodiscard]] int count() const;  // registered images, in the model's order
  [[nodiscard]] const std::string& name(int index) const;
  [[nodiscard]] const geometry::Camera& camera(int index) const;  // of the image
  [[nodiscard]] const geometry::Rigid3& pose(int index) const;    // camera_from_world
  // All images are registered, so that its images are those of the members here.
  [[nodiscard]] const Model& sparse() const { return *model_; }

  // CV_8UC3, of the size of its camera. Throws InputError.
  [[nodiscard]] cv::Mat read_image(int index) const;

  // A depth that is not finite or below 0 is unknown; normals and confidence are those of the known
  // depths, and where such a file is missing the confidence is 1 and the normal looks at the camera
  // (maps of other programs). Throws InputError.
  [[nodiscard]] DepthMap read_depth_map(int index, MapKind kind = MapKind::kGeometric) const;
  [[nodiscard]] bool has_depth_map(int index, MapKind kind = MapKind::kGeometric) const;
  // Depth last: while it is missing or old the others do not count. Throws OutputError, and
  // std::invalid_argument as DepthMap::check() and camera_of_map().
  void write_depth_map(int index, const DepthMap& map, MapKind kind = MapKind::kGeometric) const;

  [[nodiscard]] std::string path_of_image(int index) const;
  // Of `what`: "depth_maps", "normal_maps" or "confidence".
  [[nodiscard]] std::string path_of_map(int index, std::string_view what, MapKind kind) const;

 private:
  [[nodiscard]] const Image& image(int index) const;

  std::string folder_;
  std::shared_ptr<const Model> model_;
};

}  // namespace tarsier::sfm
