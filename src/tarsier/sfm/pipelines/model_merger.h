// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/pipelines/reconstructor.h"

#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

// Joins the models of folders (COLMAP's text or binary files; read_colmap()) that have images of the same names with the same
// features (sfm/mapper/model_join.h), and writes what Reconstructor writes: the joined model, the others as further ones, and
// report.json with what was joined and why others were not. Files of images are not needed. Of `options` the folder, the
// placement but for GPS and markers, binary, turntable, names_files and pipeline.seed count. Throws std::invalid_argument for
// fewer than two folders, InputError (a model that cannot be read, a lens that is no pinhole one), OutputError, Interrupted,
// and what Reconstructor throws for the placement.
[[nodiscard]] ReconstructorResult merge_models(const std::vector<std::string>& folders,
                                               const ReconstructorOptions& options,
                                               Progress& progress, const std::stop_token& stop,
                                               const ReconstructorHooks& hooks = {});

}  // namespace tarsier::sfm
