// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/atomic_file.h"

#include <opencv2/core.hpp>

#include <cstdint>
#include <fstream>
#include <span>
#include <string>
#include <vector>

namespace tarsier::sfm {

// A point of a surface.
struct CloudPoint {
  cv::Vec3f position;    // world units
  cv::Vec3f normal;      // unit, pointing out of the surface, in the world frame
  cv::Vec3b color;       // BGR
  float confidence = 0;  // 0..1
  friend bool operator==(const CloudPoint&, const CloudPoint&) = default;
};

// Writes a cloud of any size as a binary PLY file: x y z nx ny nz (float), red green blue (uchar),
// confidence (float). The file appears at commit(), completely or not at all.
class CloudWriter {
 public:
  explicit CloudWriter(const std::string& path);  // throws OutputError
  // Throws OutputError; std::invalid_argument for numbers that are not finite.
  void add(std::span<const CloudPoint> points);
  void commit();  // throws OutputError
  [[nodiscard]] std::int64_t count() const { return count_; }

 private:
  void check() const;

  std::string path_;
  AtomicFile file_;
  std::ofstream stream_;
  std::int64_t count_ = 0;
};

// Reads what CloudWriter wrote, and other binary PLY files with these properties in any order.
// Further numeric properties are skipped. Missing normals are 0, missing colours grey, missing
// confidence 1. Throws InputError: another kind of file, a truncated one, numbers that are not
// finite, more than 2^31 points.
[[nodiscard]] std::vector<CloudPoint> read_cloud(const std::string& path);

}  // namespace tarsier::sfm
