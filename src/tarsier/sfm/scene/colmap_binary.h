// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <string>

namespace tarsier::sfm {

// COLMAP's binary format (https://colmap.github.io/format.html): cameras.bin, images.bin and
// points3D.bin in one folder. They hold the same numbers as the text format (colmap.h), little
// endian.

// As write_colmap(): the same cameras, images and points with the same ids.
void write_colmap_binary(const std::string& folder, const Model& model);

// As read_colmap(), with its limits; InputError names the file, image or point.
[[nodiscard]] Model read_colmap_binary(const std::string& folder);

// Whether a folder has a binary model and no text model.
[[nodiscard]] bool is_colmap_binary(const std::string& folder);

// Throws what write_colmap() throws for an inconsistent model.
void check_model(const Model& model);

}  // namespace tarsier::sfm
