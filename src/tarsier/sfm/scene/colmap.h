// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <string>
#include <string_view>

namespace tarsier::sfm {

// COLMAP's text format (https://colmap.github.io/format.html): cameras.txt, images.txt and
// points3D.txt in one folder. COLMAP places pixel centres at 0.5, this library at 0. Writing adds
// half a pixel, reading subtracts it.

// Writes the registered images, their cameras and all points, numbered from 1 in the order of the
// model. Creates the folder. Cameras are PINHOLE, OPENCV (distorted, k3 = 0) or FULL_OPENCV. Each
// file is written completely or not at all. Throws OutputError, also for an image name that cannot
// fit into a line; std::invalid_argument for an inconsistent model (an index out of range, a track
// with fewer than two observations or of an unregistered image, a feature that does not refer to
// the point of its track, numbers that are not finite).
void write_colmap(const std::string& folder, const Model& model);

// Reads what write_colmap() or COLMAP wrote, in the order of the files. Where only binary files
// exist, those are read (colmap_binary.h). All images are registered. Text files are read line by
// line, whatever their size. Limits: 1 million cameras and images, 500 million features, 100 MB per
// line. Of two features of one image in a track, the first is kept. Points seen in only one image
// are left out. Throws InputError, which names file, line and fault: a file is missing, a number is
// missing or not finite, an id is unknown or repeated, tracks and features disagree, a name leaves
// the folder of images, a camera model is not among those of geometry/colmap_camera.h.
[[nodiscard]] Model read_colmap(const std::string& folder);

// Reads cameras.txt and images.txt only, without features and points. Feature lines are skipped
// after a check of their length, so that memory is needed for the poses only.
[[nodiscard]] Model read_colmap_poses(const std::string& folder);

// Why an image name is invalid in a model, or "": it is empty, has control characters, or leads out
// of the folder of images.
[[nodiscard]] std::string image_name_error(std::string_view name);

}  // namespace tarsier::sfm
