// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <string>
#include <string_view>

namespace tarsier::sfm {

// COLMAP's text format (https://colmap.github.io/format.html): cameras.txt, images.txt and
// points3D.txt in one folder. COLMAP's pixel middles lie at 0.5, ours at 0: half a pixel is added
// on writing and taken off on reading.

// Writes the registered images, the cameras that took them and all points, numbered from 1 in
// the order of the model; makes the folder. Cameras are PINHOLE, OPENCV (distorted, k3 = 0) or
// FULL_OPENCV. Each file is written whole or not at all. Throws OutputError, also for a name of a
// image that cannot stand in a line; std::invalid_argument for a model whose parts do not fit
// (an index out of range, a track of fewer than two, of an image that is not registered, or
// that its feature does not know of; numbers that are not finite).
void write_colmap(const std::string& folder, const Model& model);

// Reads it back, or what COLMAP itself wrote (where there are only binary files, those:
// colmap_binary.h), in the order of the files; all images are
// registered. Files of any size are read line by line; the model may have 1 million cameras and
// images and 500 million features, a line 100 MB. Where COLMAP has two features of one
// image in a track, the first stays; points seen in one image only are left out. Throws
// InputError that
// names file, line and what is wrong: a file is missing, a number is missing or not finite, an id
// is unknown or there twice, tracks and features do not agree, a name leaves the folder of
// images, a camera model is not among those of geometry/colmap_camera.h.
[[nodiscard]] Model read_colmap(const std::string& folder);

// The same without features and points, from cameras.txt and images.txt alone: of the lines of
// features only the length is looked at, and the memory is that of the poses.
[[nodiscard]] Model read_colmap_poses(const std::string& folder);

// What is wrong with an image's name in a model, or "": it is empty, has control characters, or
// leads out of the folder of images.
[[nodiscard]] std::string trouble_of_name(std::string_view name);

}  // namespace tarsier::sfm
