// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/checkpoint.h"
#include "tarsier/sfm/scene/model.h"

#include <functional>
#include <optional>
#include <string>

namespace tarsier::sfm {

// Receives a growing model: "grown-003-before" and "grown-003-after" around each adjustment (of the
// whole model, or of a new image and its neighbours), "model-0" when a model is finished.
using WatchModel = std::function<void(const std::string& label, const Model& model)>;

struct MapperHooks {
  WatchModel watch;  // receives the growing model; may be empty
  // Writes a checkpoint; may be empty. Called at most every save_interval_s, and so that it takes
  // less than a twentieth of the time; 0: at every step. Always called at the end and at an
  // interruption.
  std::function<void(const MapperState&)> save_checkpoint;
  double save_interval_s = 30;
  // Receives the growing model for display; may be empty. Called at most every show_interval_s,
  // and so that it takes less than a twentieth of the time. Does not change the result.
  std::function<void(const Model&)> show;
  double show_interval_s = 1;
  // Resumes from this state. With otherwise equal arguments the result is bit-identical. Ignored
  // where it does not fit the arguments or where there is a `watch`.
  std::optional<MapperState> resume_from;
  // Where stopped, return the models up to then, if any. Otherwise Interrupted is thrown.
  bool partial = false;
};

}  // namespace tarsier::sfm
