// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/pipelines/reconstructor.h"

#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

// Joins the models in `folders` (COLMAP's text or binary files; read_colmap()). Models can be
// joined where they share images of the same names with the same features
// (sfm/joining/join_models.h). Writes what Reconstructor writes: the joined model, the remaining
// models as further ones, and a report.json that says what was joined and why other models were
// not. The image files are not needed.
//
// These members of `options` are used: folder, placement (except GPS and markers), binary,
// turntable, names_files and pipeline.seed. Throws std::invalid_argument for fewer than two
// folders, InputError (a model that cannot be read, a lens other than pinhole), OutputError,
// Interrupted, and what Reconstructor throws for the placement.
[[nodiscard]] ReconstructorResult merge_models(const std::vector<std::string>& folders,
                                               const ReconstructorOptions& options,
                                               Progress& progress, const std::stop_token& stop,
                                               const ReconstructorHooks& hooks = {});

}  // namespace tarsier::sfm
