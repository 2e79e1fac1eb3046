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
  kPhotometric,  // from the images alone: a depth for nearly every pixel, right or wrong
  kGeometric,    // consistent with the maps of other images
};
[[nodiscard]] std::string_view name_of(MapKind kind);  // "photometric", "geometric"

// Depth maps, clouds and surfaces have coordinates in single precision. Throws Error (kInput) where
// these would distort the scene at most cameras, because the origin is too far away.
void check_coordinates(const Model& model);

// A folder of dense reconstruction, in the layout of COLMAP's dense workspace:
//
//   images/NAME                                     undistorted images
//   sparse/{cameras,images,points3D}.txt            pinhole cameras, poses, points
//   stereo/depth_maps/NAME.{photometric,geometric}.bin
//   stereo/normal_maps/NAME.{photometric,geometric}.bin
//   stereo/confidence/NAME.bin, NAME.photometric.bin     only of this library
//
// The class is const. The model is in memory; images and maps are read on request. Any number of
// threads may read; only one at a time may write a map. Indices outside 0..count()-1 throw
// std::invalid_argument.
class Workspace {
 public:
  // Reads the model. Throws InputError where something is missing or a camera is distorted.
  [[nodiscard]] static Workspace open(const std::string& folder);

  [[nodiscard]] const std::string& folder() const { return folder_; }
  [[nodiscard]] int count() const;  // registered images, in the model's order
  [[nodiscard]] const std::string& name(int index) const;
  [[nodiscard]] const geometry::Camera& camera(int index) const;  // of the image
  [[nodiscard]] const geometry::Rigid3& pose(int index) const;    // camera_from_world
  // All images are registered, so indices of Model::images are valid here.
  [[nodiscard]] const Model& sparse() const { return *model_; }

  // CV_8UC3, in the size of its camera. Throws InputError.
  [[nodiscard]] cv::Mat read_image(int index) const;

  // A depth that is not finite or below 0 is unknown. Normals and confidence belong to the known
  // depths. Where their files are missing (maps of other programs), the confidence is 1 and the
  // normal points to the camera. Throws InputError.
  [[nodiscard]] DepthMap read_depth_map(int index, MapKind kind = MapKind::kGeometric) const;
  [[nodiscard]] bool has_depth_map(int index, MapKind kind = MapKind::kGeometric) const;
  // Writes the depth last: while it is missing or old, the other files are ignored. Throws
  // OutputError, and std::invalid_argument as DepthMap::check() and camera_of_map().
  void write_depth_map(int index, const DepthMap& map, MapKind kind = MapKind::kGeometric) const;

  [[nodiscard]] std::string path_of_image(int index) const;
  // `what`: "depth_maps", "normal_maps" or "confidence".
  [[nodiscard]] std::string path_of_map(int index, std::string_view what, MapKind kind) const;

 private:
  [[nodiscard]] const Image& image(int index) const;

  std::string folder_;
  std::shared_ptr<const Model> model_;
};

}  // namespace tarsier::sfm
