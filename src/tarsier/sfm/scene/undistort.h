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

// The model with such cameras and all features where they are in the undistorted images (some
// may lie outside of them now); poses, points and tracks stay. Throws as undistorted_camera(), and
// Error for a feature so far outside of its image that it has no undistorted place.
[[nodiscard]] Model undistorted_model(const Model& model);

// Writes what dense reconstruction reads (the layout of COLMAP's image_undistorter):
// folder/sparse/{cameras,images,points3D}.txt with PINHOLE cameras, and each registered image,
// undistorted, as folder/images/NAME (JPEG of quality 95, or what else the name's ending says).
// `read_named_image` gives the image of a name, in the size of its camera. Names are checked
// before anything is written, and images come last. Throws as undistorted_model() and
// write_colmap(); OutputError for a name without an ending of write_image(), or two names that are
// one file; InputError for an image of another size than its camera; Interrupted.
void export_undistorted(const std::string& folder, const Model& model,
                        const std::function<cv::Mat(const std::string& name)>& read_named_image,
                        Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::sfm
