// SPDX-License-Identifier: MIT
#include "tarsier/media/part_file.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/atomic_file.h"

#include <fmt/format.h>

#include <cerrno>
#include <chrono>
#include <cstdio>
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

// The target with `mark` before its ending.
std::string marked_name(const fs::path& target, const std::string& mark) {
  const std::string stem = target.stem().string().substr(0, 200);  // names end at 255 bytes
  return (target.parent_path() / (stem + mark + target.extension().string().substr(0, 32)))
      .string();
}

std::string part_name(const fs::path& target, int number) {
  return marked_name(target, number == 1 ? ".part" : fmt::format(".part-{}", number));
}

std::string recording_name(const std::string& target, int number) {
  return number == 1 ? target : marked_name(target, fmt::format("-{}", number));
}

// Whether a recording can get this name: no file has it, or an empty one.
bool is_free(const std::string& path) {
  struct ::stat info {};
  return ::lstat(path.c_str(), &info) != 0 || (S_ISREG(info.st_mode) && info.st_size == 0);
}

std::string free_recording_name(const std::string& target) {
  for (int number = 1; number <= kMaxParts; ++number) {
    if (std::string name = recording_name(target, number); is_free(name)) return name;
  }
  throw OutputError(target, "too many recordings of this name: name another file");
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
  name_ = free_recording_name(target_);
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
  if (name_ != target_) log_warning("{}: exists; this recording will be {}", target_, name_);
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
  // Another recording of this name may have ended meanwhile.
  std::string name = free_recording_name(target_);
  while (!rename_to(name)) name = free_recording_name(target_);
  if (name != name_) log_warning("{}: exists; this recording is {}", name_, name);
  committed_ = true;
  sync_folder(name);
}

// Returns false if a file has got this name meanwhile.
bool PartFile::rename_to(const std::string& name) {
  struct ::stat info {};
  const bool is_new = ::lstat(name.c_str(), &info) != 0;
  if (is_new) {
    if (::renameat2(AT_FDCWD, part_.c_str(), AT_FDCWD, name.c_str(), RENAME_NOREPLACE) == 0)
      return true;
    if (errno == EEXIST) return false;
  }
  if (::rename(part_.c_str(), name.c_str()) != 0) fail_to_write(name, "cannot rename", errno);
  return true;
}

}  // namespace tarsier
