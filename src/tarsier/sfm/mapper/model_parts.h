// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

namespace tarsier::sfm {

// Two images hang together where they have `min_common` points or more in common, and so do those that others join. How
// parts of a model that do not hang together lie to each other, and how large one is beside the other, nothing measures.
// Keeps the part of most images (of two as large, the one with the first image): images of others are not registered
// then and have no features, and points that fewer than three images of the part show and others did are gone. Every
// point of `model` has observations, before and after. Returns how many images were left out.
int keep_largest_part(Model& model, int min_common = 8);

}  // namespace tarsier::sfm
