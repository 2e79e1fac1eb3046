// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/cartoon/options.h"
#include "tarsier/cartoon/plane.h"

#include <cstdint>
#include <vector>

namespace tarsier::cartoon {

// Keeps lines from flickering in video. Two memories for each pixel:
//   grey    where the image stands still, the grey level that lines are found on is averaged over
//   a few
//           frames (g += (new - g) / memory); where it moves, it is the new one at once, so that
//           nothing trails;
//   line    where the image stands still, a line needs (1 + hysteresis) threshold to appear and
//   stays above
//           (1 - hysteresis) threshold.
// A pixel moves when the mean of the change around it (5x5) or its own change is large.
class Stabilizer {
 public:
  void reset() { width_ = 0; }

  // Replaces the image of `gray` by its steady version.
  void smooth(Plane& gray, const SteadyOptions& options);

  // mask = 0 on lines, 255 elsewhere, of `response` > threshold with the hysteresis above; follows
  // smooth().
  void threshold(const Plane& response, int threshold, const SteadyOptions& options, Plane& mask);

 private:
  int width_ = 0;
  int height_ = 0;
  bool fresh_ = true;                 // no earlier frame
  std::vector<std::uint16_t> level_;  // grey in 1/256 levels
  std::vector<std::uint8_t> moved_;   // 255 where this frame's pixel moves
  std::vector<std::uint8_t> line_;    // 255 where the last mask had a line
  std::vector<std::uint8_t> change_;  // |new - level|
};

}  // namespace tarsier::cartoon
