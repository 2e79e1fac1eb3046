// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/sfm_io/model.h"

#include <opencv2/core.hpp>

#include <functional>
#include <stop_token>
#include <string>

namespace tarsier::sfm {

// A pinhole without distortion, of the same size, whose whole picture lies inside that of `camera`:
// no empty borders. The outer pixel middles of its picture are the largest upright rectangle
// between the four bent borders of `camera`'s (what cv::getOptimalNewCameraMatrix does for alpha
// 0, but with up to 1000 places on each side instead of 9), so fx, fy, cx and cy all change. A
// camera that has no distortion comes back as it is. Throws std::invalid_argument for no camera
// and Error (kBadInput) where the distortion cannot be undone everywhere in the picture, or where
// nothing remains between the borders.
[[nodiscard]] geometry::Camera undistorted_camera(const geometry::Camera& camera);

// The model with such cameras and all features where they are in the undistorted photographs (some
// may lie outside of them now); poses, points and tracks stay. Throws as undistorted_camera(), and
// Error for a feature so far outside of its photograph that it has no undistorted place.
[[nodiscard]] Model undistorted_model(const Model& model);

// The picture that `to` would have taken in the place of `from`: 8 or 16 bit, any channels,
// bicubic; outside of the source its border goes on. Throws std::invalid_argument unless `image`
// has the size of `from`, `to` has no distortion, and no side has more than 32766 px.
[[nodiscard]] cv::Mat undistort_image(const cv::Mat& image, const geometry::Camera& from,
                                      const geometry::Camera& to);

// Writes what dense reconstruction reads (the layout of COLMAP's image_undistorter):
// folder/sparse/{cameras,images,points3D}.txt with PINHOLE cameras, and each registered photograph,
// undistorted, as folder/images/NAME (JPEG of quality 95, or what else the name's ending says).
// `read_photograph` gives the picture of a name, in the size of its camera. Names are checked
// before anything is written, and pictures come last. Throws as undistorted_model() and
// write_colmap(); OutputError for a name without an ending of write_image(), or two names that are
// one file; InputError for a photograph of another size than its camera; Interrupted.
void export_undistorted(const std::string& folder, const Model& model,
                        const std::function<cv::Mat(const std::string& name)>& read_photograph,
                        Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::sfm
