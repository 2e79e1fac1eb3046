// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/mapper/pipeline.h"
#include "tarsier/sfm/scene/keyframes.h"

#include <stop_token>
#include <string>
#include <vector>

// From what a user names to the images of a reconstruction.
namespace tarsier::sfm {

// Images, folders, globs, @lists and videos. The name of an image in the model is that of its file,
// made unique ("a-2.jpg"). A folder gives the images of the folders within it as well, under their path in it
// ("cam0/0001.jpg"), sorted naturally; not those of hidden folders, of symbolic links to folders, of folders that hold a
// model or other results, and of the one that `frames_folder` is in, which is written to. Of a video the key frames are written to `frames_folder`, so that they
// are there for a second run and for whoever wants to see them. Throws InputError (missing, a
// camera, a video where `frames_folder` is empty), OutputError, Interrupted.
[[nodiscard]] std::vector<Input> find_inputs(const std::vector<std::string>& sources,
                                             const KeyframeOptions& keyframes,
                                             const std::string& frames_folder, Progress& progress,
                                             const std::stop_token& stop);

// The file of a key frame of a video or camera: frame-000012.png.
[[nodiscard]] std::string key_frame_path(const std::string& folder, const Keyframe& frame);

// All images of COLMAP's database, without files. Throws InputError.
[[nodiscard]] std::vector<Input> inputs_of_database(const std::string& path);

// Throws InputError for a name that no model's file can hold.
void require_names(const std::vector<Input>& inputs);

// Throws InputError that names `source` where there are fewer than two.
void require_two_images(const std::vector<Input>& inputs, const std::string& source);

}  // namespace tarsier::sfm
