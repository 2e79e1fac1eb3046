// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/mapper_input.h"
#include "tarsier/sfm/mapper/mapper_options.h"
#include "tarsier/sfm/scene/model.h"

#include <stop_token>

namespace tarsier::sfm {

// How to extend a model.
struct ExtendOptions {
  // Number of images in the model at the last adjustment of the whole.
  int adjusted_at = 0;
  // Adjusts the whole model in any case, and extends its tracks.
  bool adjust_all = false;
};
struct ExtendedModel {
  Model model;
  int adjusted_at = 0;  // as in ExtendOptions, for the next call
};
// Extends `before`, a model of the first images (its cameras are the first of input.cameras). Its
// poses are kept until the next adjustment. Points are triangulated again from all pairs, and
// further images are registered where possible. Throws Interrupted.
[[nodiscard]] ExtendedModel extend_model(const Model& before, const MapperInput& input,
                                         const MapperOptions& options, const ExtendOptions& extend,
                                         const std::stop_token& stop);

}  // namespace tarsier::sfm
