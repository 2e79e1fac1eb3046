// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/descriptor_store.h"

#include "tarsier/core/log.h"
#include "tarsier/core/require.h"

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr std::size_t kChunk = std::size_t{64} << 20;  // bytes that are mapped at a time
constexpr std::size_t kRow = 64;                       // bytes: where an image's descriptors begin

std::size_t rounded_up(std::size_t bytes, std::size_t to) { return (bytes + to - 1) / to * to; }

bool write_all(int file, const std::uint8_t* data, std::size_t bytes, std::size_t place) {
  while (bytes > 0) {
    const ssize_t written = ::pwrite(file, data, bytes, static_cast<off_t>(place));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return false;
    data += written;
    place += static_cast<std::size_t>(written);
    bytes -= static_cast<std::size_t>(written);
  }
  return true;
}

}  // namespace

DescriptorStore::DescriptorStore(std::string folder) : folder_(std::move(folder)) {}

DescriptorStore::~DescriptorStore() {
  for (const Chunk& chunk : chunks_) ::munmap(chunk.data, chunk.size);
  if (file_ >= 0) ::close(file_);
}

void DescriptorStore::give_up(const char* what) {
  log_warning("'{}': {} ({}); descriptors stay in memory", folder_, what, std::strerror(errno));
  folder_.clear();
}

bool DescriptorStore::make_file() {
  std::string path = folder_ + "/descriptors-XXXXXX";
  file_ = ::mkostemp(path.data(), O_CLOEXEC);
  if (file_ < 0) {
    give_up("no file can be made");
    return false;
  }
  ::unlink(path.c_str());
  return true;
}

// A chunk of so many bytes at least, from the file's end on. What lies beyond the end is not read.
bool DescriptorStore::map_next(std::size_t bytes) {
  const std::size_t place = rounded_up(size_, static_cast<std::size_t>(::sysconf(_SC_PAGESIZE)));
  const std::size_t length = std::max(kChunk, bytes);
  void* data = ::mmap(nullptr, length, PROT_READ, MAP_SHARED, file_, static_cast<off_t>(place));
  if (data == MAP_FAILED) {
    give_up("a file cannot be mapped into memory");
    return false;
  }
  chunks_.push_back({data, length});
  filled_ = 0;
  size_ = place;
  return true;
}

cv::Mat DescriptorStore::add(const cv::Mat& descriptors) {
  TARSIER_REQUIRE(descriptors.empty() || descriptors.type() == CV_8UC1, "descriptors of type {}",
                  descriptors.type());
  if (descriptors.empty() || folder_.empty()) return descriptors;
  const cv::Mat rows = descriptors.isContinuous() ? descriptors : descriptors.clone();
  const std::size_t bytes = rows.total();
  if (file_ < 0 && !make_file()) return descriptors;
  if ((chunks_.empty() || filled_ + bytes > chunks_.back().size) && !map_next(bytes))
    return descriptors;
  if (!write_all(file_, rows.data, bytes, size_)) {
    give_up("the file cannot be written");
    return descriptors;
  }
  auto* data = static_cast<std::uint8_t*>(chunks_.back().data) + filled_;
  const std::size_t taken = rounded_up(bytes, kRow);
  filled_ = std::min(filled_ + taken, chunks_.back().size);
  size_ += taken;
  return {rows.rows, rows.cols, CV_8UC1, data};
}

void DescriptorStore::release() const {
  for (const Chunk& chunk : chunks_) ::madvise(chunk.data, chunk.size, MADV_DONTNEED);
}

}  // namespace tarsier::sfm
