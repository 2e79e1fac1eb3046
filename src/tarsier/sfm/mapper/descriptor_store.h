// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <cstddef>
#include <string>
#include <vector>

namespace tarsier::sfm {

// The descriptors of many images in a file that is mapped into memory: 650 kB an image of 5000 SIFT features, of which those
// take up memory that are being used. The file has no name and goes with the store. Where it cannot be made or the disk
// is full, what comes stays in memory, with a warning.
class DescriptorStore {
 public:
  // `folder`: where the file is made; empty: all stays in memory.
  explicit DescriptorStore(std::string folder);
  ~DescriptorStore();
  DescriptorStore(const DescriptorStore&) = delete;
  DescriptorStore& operator=(const DescriptorStore&) = delete;

  // The same numbers, as long as the store is there; they are only read. CV_8UC1.
  [[nodiscard]] cv::Mat add(const cv::Mat& descriptors);
  // They will not be needed for a while: takes them out of memory. Each is read again where it is used.
  void release() const;
  // Of the file.
  [[nodiscard]] std::size_t bytes() const { return size_; }

 private:
  struct Chunk {
    void* data = nullptr;
    std::size_t size = 0;
  };
  [[nodiscard]] bool make_file();
  [[nodiscard]] bool map_next(std::size_t bytes);
  void give_up(const char* what);

  std::string folder_;
  int file_ = -1;
  std::size_t size_ = 0;  // written
  std::vector<Chunk> chunks_;
  std::size_t filled_ = 0;  // of the last chunk
};

}  // namespace tarsier::sfm
