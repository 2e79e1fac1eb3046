// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/cartoon/options.h"
#include "tarsier/cartoon/plane.h"

#include <cstdint>
#include <vector>

namespace tarsier::cartoon {

// Reduces the flicker of lines in video. Each pixel has two memories:
//    grey    if the image is still, the grey level used for line detection is averaged over a few
//            frames (g += (new - g) / memory); if it moves, the new value is used at once, so that
//            nothing trails
//    line    if the image is still, a line appears above (1 + hysteresis) threshold and stays above
//            (1 - hysteresis) threshold
// A pixel moves if its own change, or the mean change of the surrounding 5x5 pixels, is large.
class Stabilizer {
 public:
  void reset() { width_ = 0; }

  // Replaces the image of `gray` by its steady version.
  void smooth(Plane& gray, const SteadyOptions& options);

  // mask = 0 on lines, 255 elsewhere, from `response` > threshold with the hysteresis above. Call
  // it after smooth().
  void threshold(const Plane& response, int threshold, const SteadyOptions& options, Plane& mask);

 private:
  int width_ = 0;
  int height_ = 0;
  bool fresh_ = true;                 // no earlier frame
  std::vector<std::uint16_t> level_;  // grey level times 256
  std::vector<std::uint8_t> moved_;   // 255 where the pixel moves in this frame
  std::vector<std::uint8_t> line_;    // 255 where the last mask had a line
  std::vector<std::uint8_t> change_;  // |new - level|
};

}  // namespace tarsier::cartoon
