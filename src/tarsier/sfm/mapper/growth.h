// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/incremental_mapper.h"

#include <functional>
#include <map>
#include <stop_token>
#include <string>
#include <vector>

// The inside of the mapper: the steps by which one model grows from its first images to its end.
namespace tarsier::sfm {

// Where a model is on its way, beside the model itself.
struct Growth {
  std::map<int, int> failed;  // images that could not be added, and the points that they saw then
  int adjusted_at = 0;        // images in it when all of it was last adjusted
  int stage = 0;              // 0: images are added; then the steps of the end
  int round = 0;              // of the stage
  // No state that another process could go on from: tracks are being extended.
  bool between_states = false;
};

// All of them may be empty.
struct GrowthHooks {
  std::function<void()> step;  // is called where a checkpoint can be made
  // An image, whether it was added, and why not.
  std::function<void(int image, bool added, const std::string& why)> tried;
  std::function<void(std::string line)> trouble;  // what went wrong in an adjustment
};

// Adds what sees most, until nothing more can be added; not the images that are `used`. `thorough`: when nothing more can,
// all of the model is adjusted and what failed is tried once more. Throws Interrupted.
void add_images(IncrementalMapper& mapper, const std::vector<bool>& used, bool thorough,
                Growth& growth, const GrowthHooks& hooks, const std::stop_token& stop);

// From where the model is to its end: images are added, all of it is adjusted, its tracks are extended, and it is adjusted
// once more. Each round is a state of its own, from which another process can go on. Throws Interrupted.
void grow(IncrementalMapper& mapper, const std::vector<bool>& used, Growth& growth,
          const GrowthHooks& hooks, const std::stop_token& stop);

}  // namespace tarsier::sfm
