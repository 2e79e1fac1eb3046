// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/pipelines/pipeline.h"
#include "tarsier/sfm/scene/model.h"

#include <opencv2/core/mat.hpp>

#include <stop_token>
#include <string>
#include <vector>

// Writes the files of a model. Each file is written completely or not at all. All functions throw
// OutputError.
namespace tarsier::sfm {

// Writes cameras.txt, images.txt, points3D.txt (COLMAP), points.ply and cameras.ply.
void write_model(const std::string& folder, const Model& model);

// Writes view.html and view.png.
void write_views(const std::string& folder, const Model& model);

// Writes turntable.gif, an animation of the rotating point cloud: 36 images of 640x480.
void write_turntable(const std::string& folder, const Model& model);

// Writes undistorted/, the images and the model for dense reconstruction; see export_undistorted().
// Throws InputError for an image that can no longer be read, Interrupted.
void write_undistorted(const std::string& folder, const Model& model,
                       const std::vector<Input>& inputs, Progress& progress,
                       const std::stop_token& stop);

// Draws both images side by side: inliers in green, outliers in red. All matches are drawn
// as dots. Lines are drawn only for as many as can be distinguished. Throws InputError.
[[nodiscard]] cv::Mat draw_matches(const ComparedPair& pair);

}  // namespace tarsier::sfm
