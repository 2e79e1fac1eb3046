// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/pipelines/pipeline.h"
#include "tarsier/sfm/scene/keyframes.h"

#include <stop_token>
#include <string>
#include <vector>

// Turns the sources that a user names into the input images of a reconstruction.
namespace tarsier::sfm {

// Finds the images of `sources`: image files, folders, globs, @lists and videos.
// - An image is named after its file. A repeated name is made unique ("a-2.jpg").
// - A folder is searched recursively. Its images are named by their path in it ("cam0/0001.jpg")
//   and sorted naturally. Skipped are hidden folders, symbolic links to folders, folders that hold
//   a model or other results, and the folder that contains `frames_folder`.
// - The key frames of a video are written to `frames_folder`.
//
// Throws InputError (a missing file, a camera, a video where `frames_folder` is empty),
// OutputError, Interrupted.
[[nodiscard]] std::vector<Input> find_inputs(const std::vector<std::string>& sources,
                                             const KeyframeOptions& keyframes,
                                             const std::string& frames_folder, Progress& progress,
                                             const std::stop_token& stop);

// Path of the file of a key frame, e.g. frame-000012.png.
[[nodiscard]] std::string key_frame_path(const std::string& folder, const Keyframe& frame);

// All images of a COLMAP database, without image files. Throws InputError.
[[nodiscard]] std::vector<Input> inputs_of_database(const std::string& path);

// Throws InputError for a name that a model file cannot hold.
void require_names(const std::vector<Input>& inputs);

// Throws InputError, which names `source`, where there are fewer than two inputs.
void require_two_images(const std::vector<Input>& inputs, const std::string& source);

}  // namespace tarsier::sfm
