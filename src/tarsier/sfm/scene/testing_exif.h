// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <vector>

namespace tarsier::sfm {

// Inserts an APP1 segment into a JPEG file. Its only content is the EXIF orientation, 1..8.
inline std::vector<std::uint8_t> with_orientation(std::vector<std::uint8_t> jpeg, int orientation) {
  const std::vector<std::uint8_t> segment{
      0xFF, 0xE1, 0, 34, 'E', 'x', 'i', 'f', 0, 0,  // the length includes its own two bytes
      'M',  'M',  0, 42, 0,   0,   0,   8,          // TIFF, big-endian; the directory follows
      0,    1,    1, 18, 0,   3,   0,   0,   0, 1, 0, static_cast<std::uint8_t>(orientation),
      0,    0,    0, 0,  0,   0};
  jpeg.insert(jpeg.begin() + 2, segment.begin(), segment.end());
  return jpeg;
}

}  // namespace tarsier::sfm
