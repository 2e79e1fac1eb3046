// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/mapped_store.h"

#include "tarsier/core/log.h"
#include "tarsier/core/require.h"

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <fstream>
#include <sys/mman.h>
#include <unistd.h>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

constexpr std::size_t kChunk = std::size_t{64} << 20;  // bytes mapped at a time
constexpr std::size_t kBlockAlignment = 64;            // alignment of a block of numbers, bytes

std::size_t page_size() { return static_cast<std::size_t>(::sysconf(_SC_PAGESIZE)); }

std::size_t rounded_up(std::size_t bytes, std::size_t to) { return (bytes + to - 1) / to * to; }

bool write_all(int file, const std::uint8_t* data, std::size_t bytes, std::size_t offset) {
  while (bytes > 0) {
    const ssize_t written = ::pwrite(file, data, bytes, static_cast<off_t>(offset));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return false;
    data += written;
    offset += static_cast<std::size_t>(written);
    bytes -= static_cast<std::size_t>(written);
  }
  return true;
}

// Resident memory of the process, bytes; 0 where unknown.
std::size_t resident_bytes() {
  std::size_t size = 0;
  std::size_t resident = 0;
  std::ifstream("/proc/self/statm") >> size >> resident;
  return resident * page_size();
}

}  // namespace

// An unnamed file and its mapped parts.
class MappedStore::File {
 public:
  File() = default;
  ~File() {
    for (const Chunk& chunk : chunks_) ::munmap(chunk.data, chunk.size);
    if (file_ >= 0) ::close(file_);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;

  // The functions below return null, or the failed operation; errno is the reason.
  [[nodiscard]] const char* make(const std::string& folder) {
    std::string path = folder + "/features-XXXXXX";
    file_ = ::mkostemp(path.data(), O_CLOEXEC);
    if (file_ < 0) return "cannot create a file";
    ::unlink(path.c_str());
    return nullptr;
  }
  [[nodiscard]] const char* append(const std::uint8_t* data, std::size_t bytes,
                                   const std::uint8_t*& address) {
    if (chunks_.empty() || filled_ + bytes > chunks_.back().size) {
      if (const char* failed = map_next(bytes)) return failed;
    }
    if (!write_all(file_, data, bytes, size_)) return "cannot write the file";
    address = static_cast<const std::uint8_t*>(chunks_.back().data) + filled_;
    const std::size_t padded_bytes = rounded_up(bytes, kBlockAlignment);
    filled_ = std::min(filled_ + padded_bytes, chunks_.back().size);
    size_ += padded_bytes;
    return nullptr;
  }

  void release() const {
    for (const Chunk& chunk : chunks_) ::madvise(chunk.data, chunk.size, MADV_DONTNEED);
  }
  [[nodiscard]] std::size_t size() const { return size_; }

 private:
  struct Chunk {
    void* data = nullptr;
    std::size_t size = 0;
  };

  // Maps a chunk of at least `bytes` from the end of the file on. Data beyond the end are not read.
  [[nodiscard]] const char* map_next(std::size_t bytes) {
    const std::size_t offset = rounded_up(size_, page_size());
    const std::size_t length = std::max(kChunk, bytes);
    void* data = ::mmap(nullptr, length, PROT_READ, MAP_SHARED, file_, static_cast<off_t>(offset));
    if (data == MAP_FAILED) return "cannot map the file into memory";
    chunks_.push_back({data, length});
    filled_ = 0;
    size_ = offset;
    return nullptr;
  }

  int file_ = -1;
  std::size_t size_ = 0;  // written
  std::vector<Chunk> chunks_;
  std::size_t filled_ = 0;  // bytes used in the last chunk
};

MappedStore::MappedStore(std::string folder, std::size_t limit)
    : folder_(std::move(folder)), limit_(limit) {}

MappedStore::~MappedStore() = default;

std::size_t MappedStore::bytes() const { return file_ ? file_->size() : 0; }

void MappedStore::give_up(const char* what) {
  log_warning("'{}': {} ({}); descriptors and matches stay in memory", folder_, what,
              std::strerror(errno));
  folder_.clear();
}

const std::uint8_t* MappedStore::append(const void* data, std::size_t bytes) {
  if (bytes == 0 || folder_.empty()) return nullptr;
  const std::uint8_t* address = nullptr;
  const char* failed = nullptr;
  if (!file_) {
    file_ = std::make_shared<File>();
    failed = file_->make(folder_);
  }
  if (failed == nullptr)
    failed = file_->append(static_cast<const std::uint8_t*>(data), bytes, address);
  if (failed != nullptr) give_up(failed);
  return address;
}

cv::Mat MappedStore::add(const cv::Mat& descriptors) {
  TARSIER_REQUIRE(descriptors.empty() || descriptors.type() == CV_8UC1, "descriptors of type {}",
                  descriptors.type());
  const cv::Mat rows = descriptors.isContinuous() ? descriptors : descriptors.clone();
  const std::uint8_t* address = append(rows.data, rows.total());
  if (address == nullptr) return descriptors;
  // the data are only read
  return {rows.rows, rows.cols, CV_8UC1, const_cast<std::uint8_t*>(address)};
}

MatchList MappedStore::add(const MatchList& matches) {
  const std::uint8_t* address = append(matches.data(), matches.size() * sizeof(Match));
  if (address == nullptr) return matches;
  return {file_, {reinterpret_cast<const Match*>(address), matches.size()}};
}

void MappedStore::trim() {
  if (!file_ || (limit_ > 0 && resident_bytes() <= limit_)) return;
  file_->release();
  if (limit_ == 0 || warned_) return;
  const std::size_t left = resident_bytes();
  if (left <= limit_) return;
  warned_ = true;
  log_warning(
      "the memory limit of {} MB is too low: {} MB are in use in addition to the data on disk; set "
      "a higher limit",
      limit_ / 1'000'000, left / 1'000'000);
}

}  // namespace tarsier::sfm
