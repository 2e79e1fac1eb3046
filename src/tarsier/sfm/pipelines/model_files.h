// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/mapper/pipeline.h"
#include "tarsier/sfm/scene/model.h"

#include <opencv2/core/mat.hpp>

#include <stop_token>
#include <string>
#include <vector>

// The files of a model. All are written whole or not at all; all throw OutputError.
namespace tarsier::sfm {

// cameras.txt, images.txt, points3D.txt (COLMAP), points.ply, cameras.ply.
void write_model(const std::string& folder, const Model& model);

// view.html and view.png.
void write_views(const std::string& folder, const Model& model);

// turntable.gif: the cloud, turning; 36 images of 640x480.
void write_turntable(const std::string& folder, const Model& model);

// undistorted/: images and model for dense reconstruction, see export_undistorted(). Throws
// InputError for an image that cannot be read any more, Interrupted.
void write_undistorted(const std::string& folder, const Model& model,
                       const std::vector<Input>& inputs, Progress& progress,
                       const std::stop_token& stop);

// Both images side by side: matches that were kept in green, removed ones in red. All as dots, as
// many with lines as can be distinguished. Throws InputError.
[[nodiscard]] cv::Mat draw_matches(const ComparedPair& pair);

}  // namespace tarsier::sfm
