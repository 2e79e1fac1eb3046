// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/patches.h"
#include "tarsier/face/regression/starts.h"
#include "tarsier/face/regression/training_face.h"
#include "tarsier/face/regression/trees.h"
#include "tarsier/face/shape/landmark_set.h"
#include "tarsier/face/shape/shape_model.h"

#include <cstdint>
#include <limits>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::face::landmarks {

struct TrainModelOptions {
  bool mirror = false;
  bool trees = true;  // which parts to train
  bool descent = true;
  bool patches = true;
  bool quality = true;
  // px; NaN: measured (see DescentReport::to_the_right) if mirrored faces are used.
  double to_the_right = std::numeric_limits<double>::quiet_NaN();
  int starts = 24;  // per face
  // Additional training faces for trees, descent and quality; empty: none.
  regression::ExtraFaces extra;
  // Additional starts, for models whose fits are repeated from a better start than the mean shape;
  // empty: none.
  regression::StartShapes start_shapes;
  int shaped_starts = 4;  // per face, if start_shapes is set
  shape::ShapeModelOptions shape;
  regression::TreesOptions tree_options;
  regression::DescentOptions descent_options;
  regression::PatchOptions patch_options;
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"starts", starts, range(1, 200), "--scatter",
             "number of random initial shapes for each face"},
            {"shaped_starts", shaped_starts, range(1, 200)}};
  }
  void check() const;
};

struct TrainedModel {
  LandmarkModel model;
  int faces = 0;                     // without mirrored ones
  int extra = 0;                     // made from them, without mirrored ones
  int detected = 0;                  // number of faces that the face detector detected
  double to_the_right = 0;           // px, the value that was used
  std::vector<std::string> skipped;  // "path: reason"
};

// Trains all parts on a set of annotated images. Throws InputError (no usable image), Interrupted.
[[nodiscard]] TrainedModel train_landmark_model(const shape::LandmarkSet& set,
                                                const std::string& set_path,
                                                const TrainModelOptions& options,
                                                Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::face::landmarks
