// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/incremental_mapper.h"

#include <functional>
#include <map>
#include <stop_token>
#include <string>
#include <vector>

// Internal to the mappers: the steps of a model's growth, from its first images to the end.
namespace tarsier::sfm {

// The state of a model's growth, besides the model itself.
struct Growth {
  // images that could not be added, with the number of points they saw then
  std::map<int, int> failed;
  int adjusted_at = 0;  // number of images at the last adjustment of the whole
  int stage = 0;        // 0: images are added; then the final steps
  int round = 0;        // within the stage
  // Tracks are being extended. This is not a state from which another process can resume.
  bool between_states = false;
};

// All of them may be empty.
struct GrowthHooks {
  std::function<void()> step;  // called where a checkpoint can be made
  // Receives an image, whether it was added, and why not.
  std::function<void(int image, bool added, const std::string& why)> attempted;
  std::function<void(std::string line)> warning;  // receives warnings of adjustments
};

// Adds the images that see most of the model, until no more can be added; never images in `used`.
// `thorough`: then adjusts the whole model and tries failed images once more. Throws Interrupted.
void add_images(IncrementalMapper& mapper, const std::vector<bool>& used, bool thorough,
                Growth& growth, const GrowthHooks& hooks, const std::stop_token& stop);

// Grows the model to its end: adds images, adjusts the whole, extends its tracks, and adjusts once
// more. Each round is a state from which another process can resume. Throws Interrupted.
void grow(IncrementalMapper& mapper, const std::vector<bool>& used, Growth& growth,
          const GrowthHooks& hooks, const std::stop_token& stop);

}  // namespace tarsier::sfm
