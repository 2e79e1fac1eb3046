// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/match_list.h"

#include <opencv2/core/mat.hpp>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

namespace tarsier::sfm {

// Descriptors and matches of many images in a file that is mapped into memory: of an image of 5000 SIFT features 650 kB of
// descriptors, of each of its pairs 8 bytes a match. Those take up memory that are being used. The file has no name and
// goes with the store and the matches that came from it. Where it cannot be made or the disk is full, what comes stays in
// memory, with a warning.
class MappedStore {
 public:
  // `folder`: where the file is made; empty: all stays in memory. `limit`: bytes that the process may take up (trim()).
  explicit MappedStore(std::string folder, std::size_t limit = 0);
  ~MappedStore();
  MappedStore(const MappedStore&) = delete;
  MappedStore& operator=(const MappedStore&) = delete;

  // The same numbers, as long as the store is there; they are only read. CV_8UC1.
  [[nodiscard]] cv::Mat add(const cv::Mat& descriptors);
  [[nodiscard]] MatchList add(const MatchList& matches);
  // To be called often, when what was used will not be for a while: takes it out of memory, where the process takes up more
  // than the limit, and warns once if that does not help. All of it is read again where it is used.
  void trim();
  // Of the file.
  [[nodiscard]] std::size_t bytes() const;

 private:
  class File;
  // Where the bytes lie in the file; null: they are not kept there.
  [[nodiscard]] const std::uint8_t* keep(const void* data, std::size_t bytes);
  void give_up(const char* what);

  std::string folder_;
  std::size_t limit_ = 0;
  std::shared_ptr<File> file_;
  bool warned_ = false;
};

}  // namespace tarsier::sfm
