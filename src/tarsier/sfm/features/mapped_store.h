// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/features/match_list.h"

#include <opencv2/core/mat.hpp>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

namespace tarsier::sfm {

// Descriptors and matches of many images, in a memory-mapped file. An image with 5000 SIFT features
// has 650 kB of descriptors, and each of its pairs 8 bytes per match. Only those in use occupy
// memory. The file has no name and vanishes with the store and the matches that came from it. Where
// the file cannot be made or the disk is full, the data stay in memory, with a warning.
class MappedStore {
 public:
  // `folder` of the file; empty: all data stay in memory. `limit`: memory that the process may use,
  // bytes (trim()).
  explicit MappedStore(std::string folder, std::size_t limit = 0);
  ~MappedStore();
  MappedStore(const MappedStore&) = delete;
  MappedStore& operator=(const MappedStore&) = delete;

  // Returns the same numbers, read-only and valid as long as the store. CV_8UC1.
  [[nodiscard]] cv::Mat add(const cv::Mat& descriptors);
  [[nodiscard]] MatchList add(const MatchList& matches);
  // Call often, when the data used so far will not be needed for a while. Releases them from memory
  // where the process uses more than the limit, and warns once if that does not help. They are read
  // again on use.
  void trim();
  // Size of the file.
  [[nodiscard]] std::size_t bytes() const;

 private:
  class File;
  // Address of the bytes in the mapped file; null where they could not be stored.
  [[nodiscard]] const std::uint8_t* append(const void* data, std::size_t bytes);
  void give_up(const char* what);

  std::string folder_;
  std::size_t limit_ = 0;
  std::shared_ptr<File> file_;
  bool warned_ = false;
};

}  // namespace tarsier::sfm
