// SPDX-License-Identifier: MIT
#include "tarsier/media/part_file.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/atomic_file.h"

#include <fmt/format.h>

#include <cerrno>
#include <chrono>
#include <fcntl.h>
#include <filesystem>
#include <sys/file.h>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace tarsier {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::seconds kSyncInterval{5};
constexpr int kMaxParts = 999;

std::string part_name(const fs::path& target, int number) {
  const std::string stem = target.stem().string().substr(0, 200);  // names end at 255 bytes
  const std::string mark = number == 1 ? ".part" : fmt::format(".part-{}", number);
  return (target.parent_path() / (stem + mark + target.extension().string().substr(0, 32)))
      .string();
}

// Warns of an existing file: of a recording in progress, or of one that was cut off.
void warn_of(const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) return;
  if (::flock(fd, LOCK_EX | LOCK_NB) == 0) {
    log_warning("{}: left by a recording that was cut off; it plays: rename it to keep it", path);
  }
  ::close(fd);
}

}  // namespace

PartFile::PartFile(std::string target) : target_(std::move(target)) {
  if (target_.empty()) throw OutputError("\"\"", "no file name given");
  struct ::stat info {};
  const bool exists = ::stat(target_.c_str(), &info) == 0;
  if (!exists && errno != ENOENT) fail_to_write(target_, "cannot write", errno);
  if (exists && S_ISDIR(info.st_mode)) throw OutputError(target_, "is a folder, not a file");
  if (exists && !S_ISREG(info.st_mode)) throw OutputError(target_, "is not a regular file");
  if (exists && ::access(target_.c_str(), W_OK) != 0) fail_to_write(target_, "cannot write", errno);
  if (exists) {  // a symbolic link stays a link
    std::error_code error;
    const fs::path real = fs::canonical(target_, error);
    if (!error) target_ = real.string();
  }
  for (int number = 1; number <= kMaxParts && fd_ < 0; ++number) {
    part_ = part_name(target_, number);
    fd_ = ::open(part_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (fd_ >= 0) break;
    if (errno != EEXIST) {
      fail_to_write(target_,
                    errno == ENOENT ? "no such folder" : "cannot create a file in this folder",
                    errno);
    }
    warn_of(part_);
  }
  if (fd_ < 0) throw OutputError(target_, "too many recordings that were cut off lie beside it");
  (void)::flock(fd_, LOCK_EX | LOCK_NB);  // if the file system has locks
  if (exists) (void)::fchmod(fd_, info.st_mode & 0777);
  syncing_ = std::jthread([this](const std::stop_token& stop) {
    while (sleep_unless_stopped(kSyncInterval, stop)) (void)::fdatasync(fd_);
  });
}

PartFile::~PartFile() {
  syncing_ = {};
  struct ::stat info {};
  if (!committed_ && ::fstat(fd_, &info) == 0 && info.st_size == 0) (void)::unlink(part_.c_str());
  ::close(fd_);
}

void PartFile::commit() {
  if (committed_) return;
  if (::fsync(fd_) != 0 && errno != EINVAL && errno != ENOTSUP && errno != ENOSYS) {
    fail_to_write(part_, "cannot write to the disk", errno);
  }
  if (::rename(part_.c_str(), target_.c_str()) != 0) fail_to_write(target_, "cannot rename", errno);
  committed_ = true;
  sync_folder(target_);
}

}  // namespace tarsier
