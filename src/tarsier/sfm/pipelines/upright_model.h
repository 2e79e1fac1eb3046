// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

// The direction of gravity in models of turned images.
namespace tarsier::sfm {

// A model's world is initially the frame of one of its images. Where images are turned, that frame
// may lie on its side. This rotates the world so that down is y, as it is without turned images.
void turn_upright(Model& model);

}  // namespace tarsier::sfm
