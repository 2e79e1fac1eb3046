// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/geometry/undistort.h"
#include "tarsier/sfm/scene/model.h"

#include <opencv2/core/mat.hpp>

#include <functional>
#include <stop_token>
#include <string>

namespace tarsier::sfm {

using geometry::undistort_image;
using geometry::undistorted_camera;

// The model with undistorted cameras and the features at their positions in the undistorted images.
// Some features may lie outside of the images. Poses, points and tracks do not change. Throws as
// undistorted_camera(), and Error for a feature so far outside its image that it has no undistorted
// position.
[[nodiscard]] Model undistorted_model(const Model& model);

// Writes the input of dense reconstruction, in the layout of COLMAP's image_undistorter:
// folder/sparse/{cameras,images,points3D}.txt with PINHOLE cameras, and each registered image,
// undistorted, as folder/images/NAME (JPEG of quality 95, or the format of the name's extension).
// `read_named_image` returns the image of a name, in the size of its camera. Names are checked
// before anything is written, and images are written last. Throws as undistorted_model() and
// write_colmap(); OutputError for a name without an extension that write_image() knows, or two
// names of the same file; InputError for an image whose size differs from its camera's;
// Interrupted.
void export_undistorted(const std::string& folder, const Model& model,
                        const std::function<cv::Mat(const std::string& name)>& read_named_image,
                        Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::sfm
