// SPDX-License-Identifier: MIT
#include "tarsier/media/atomic_file.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/media/file_descriptor.h"

#include <fmt/format.h>

#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <mutex>
#include <random>
#include <set>
#include <sys/file.h>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace tarsier {
namespace {

namespace fs = std::filesystem;

bool sync_is_unsupported(int error) {
  return error == EINVAL || error == ENOTSUP || error == ENOSYS || error == EROFS;
}

fs::path folder_of(const std::string& path) {
  const fs::path folder = fs::path(path).parent_path();
  return folder.empty() ? fs::path(".") : folder;
}

constexpr std::string_view kTemporaryMark = ".tarsier-";
constexpr std::size_t kDigits = 6;
constexpr std::uintmax_t kMaxRemoved = 10'000'000;  // bytes that are removed without a warning

// ".STEM.tarsier-012abc.ENDING": the names of make_temporary().
bool is_temporary_name(std::string_view name) {
  const std::size_t mark = name.rfind(kTemporaryMark);
  if (!name.starts_with('.') || mark == std::string_view::npos || mark < 2) return false;
  const std::string_view rest = name.substr(mark + kTemporaryMark.size());
  return rest.size() >= kDigits &&
         rest.substr(0, kDigits).find_first_not_of("0123456789abcdef") == std::string_view::npos &&
         (rest.size() == kDigits || rest[kDigits] == '.');
}

// Bytes of a file, or of all files in a folder.
std::uintmax_t size_of(const fs::path& path, const struct ::stat& info) {
  if (S_ISREG(info.st_mode)) return static_cast<std::uintmax_t>(info.st_size);
  std::uintmax_t sum = 0;
  std::error_code error;
  for (fs::recursive_directory_iterator entry(path, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    if (entry->is_regular_file(ignored)) sum += entry->file_size(ignored);
  }
  return sum;
}

// Removes this user's temporary files and folders of killed programs: nobody locks them. Large ones
// may be hours of work and are left to the user. Each folder is searched only once per process, so
// that writing thousands of images to a folder is not slowed down.
void remove_abandoned(const fs::path& folder) {
  static std::mutex mutex;
  static std::set<std::string> seen;
  std::error_code error;
  {
    const std::lock_guard lock(mutex);
    if (!seen.insert(fs::absolute(folder, error).string()).second) return;
  }
  struct ::stat info {};
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string path = entry->path().string();
    if (!is_temporary_name(entry->path().filename().string())) continue;
    const FileDescriptor fd(::open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
    if (fd.get() < 0 || ::fstat(fd.get(), &info) != 0) continue;
    const bool is_ours =
        (S_ISREG(info.st_mode) || S_ISDIR(info.st_mode)) && info.st_uid == ::geteuid();
    if (!is_ours || ::flock(fd.get(), LOCK_EX | LOCK_NB) != 0) continue;
    if (const std::uintmax_t size = size_of(entry->path(), info); size > kMaxRemoved) {
      log_warning(
          "{}: left by a program that was killed ({} MB); rename it to keep what is in it, or "
          "delete it",
          path, size / 1'000'000);
      continue;
    }
    std::error_code ignored;
    fs::remove_all(path, ignored);
  }
}

// Locks a new temporary file. Returns false if another program has just taken it for an abandoned
// one. If the file system has no locks the file stays unlocked, and nobody removes it.
bool take(int fd) {
  if (::flock(fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) return false;
  struct ::stat info {};
  return ::fstat(fd, &info) != 0 || info.st_nlink > 0;
}

struct Temporary {
  std::string path;
  int fd = -1;  // open and locked
};

// ".NAME.tarsier-012abc.ENDING" in the folder of `target`.
std::string temporary_name(const std::string& target, std::random_device& random) {
  const fs::path file = fs::path(target).filename();
  const std::string stem = file.stem().string().substr(0, 180);  // names end at 255 bytes
  const std::string extension = file.extension().string().substr(0, 32);
  const std::string name =
      fmt::format(".{}{}{:06x}{}", stem, kTemporaryMark, random() & 0xFFFFFFU, extension);
  return (folder_of(target) / name).string();
}

// Creates a new empty file beside `target`, with the mode of the umask, or with the mode of
// `target` if that exists.
Temporary make_temporary(const std::string& target, const struct ::stat* existing) {
  remove_abandoned(folder_of(target));
  std::random_device random;
  for (int attempt = 0; attempt < 100; ++attempt) {
    const std::string path = temporary_name(target, random);
    FileDescriptor fd(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
    if (fd.get() >= 0) {
      if (!take(fd.get())) continue;
      if (existing != nullptr) (void)::fchmod(fd.get(), existing->st_mode & 0777);
      return {path, fd.release()};
    }
    if (errno != EEXIST) {
      const int error = errno;
      if (error == ENOENT)
        throw OutputError(target, fmt::format("the folder {} does not exist; create it first",
                                              folder_of(target).string()));
      fail_to_write(target, "cannot create a file in this folder", error);
    }
  }
  throw OutputError(target, "cannot find a free name for a temporary file");
}

}  // namespace

void fail_to_write(const std::string& path, std::string_view reason, int error) {
  throw OutputError(path, fmt::format("{}: {}", reason, errno_text(error)));
}

void write_all(int fd, std::string_view bytes, const std::string& path) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd, bytes.data(), bytes.size());
    if (written < 0) {
      if (errno == EINTR) continue;
      fail_to_write(path, "cannot write", errno);
    }
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
}

void sync_folder(const std::string& path) {
  const FileDescriptor folder(::open(folder_of(path).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (folder.get() >= 0) (void)::fsync(folder.get());
}

AtomicFile::AtomicFile(std::string target) : target_(std::move(target)) {
  if (target_.empty()) throw OutputError("\"\"", "no file name given");
  struct ::stat info {};
  const bool exists = ::stat(target_.c_str(), &info) == 0;
  if (!exists && errno != ENOENT) fail_to_write(target_, "cannot write", errno);
  if (exists && S_ISDIR(info.st_mode)) throw OutputError(target_, "is a folder, not a file");
  if (!exists && target_.back() == '/') throw OutputError(target_, "names a folder, not a file");
  if (exists && ::access(target_.c_str(), W_OK) != 0) fail_to_write(target_, "cannot write", errno);
  if (exists && !S_ISREG(info.st_mode)) {
    temporary_ = target_;  // a device or pipe: rename is impossible
    return;
  }
  if (exists) {
    // A symbolic link stays a link: its target is replaced.
    std::error_code error;
    const fs::path real = fs::canonical(target_, error);
    if (!error) target_ = real.string();
  }
  Temporary temporary = make_temporary(target_, exists ? &info : nullptr);
  temporary_ = std::move(temporary.path);
  lock_ = temporary.fd;
}

AtomicFile::~AtomicFile() {
  if (!committed_ && !temporary_.empty() && temporary_ != target_)
    (void)::unlink(temporary_.c_str());
  if (lock_ >= 0) ::close(lock_);
}

void AtomicFile::commit() {
  if (committed_) return;
  if (temporary_ == target_) {
    committed_ = true;
    return;
  }
  FileDescriptor fd(::open(temporary_.c_str(), O_RDONLY | O_CLOEXEC));
  if (fd.get() < 0) fail_to_write(target_, "cannot reopen what was written", errno);
  if (::fsync(fd.get()) != 0 && !sync_is_unsupported(errno)) {
    fail_to_write(target_, "cannot write to the disk", errno);
  }
  if (fd.close() != 0) fail_to_write(target_, "cannot write to the disk", errno);
  if (::rename(temporary_.c_str(), target_.c_str()) != 0)
    fail_to_write(target_, "cannot rename", errno);
  committed_ = true;
  sync_folder(target_);
}

void write_file_atomically(const std::string& path, std::string_view bytes) {
  AtomicFile file(path);
  {
    FileDescriptor fd(::open(file.path().c_str(), O_WRONLY | O_CLOEXEC));
    if (fd.get() < 0) fail_to_write(path, "cannot write", errno);
    write_all(fd.get(), bytes, path);
    if (fd.close() != 0) fail_to_write(path, "cannot write", errno);
  }
  file.commit();
}

void write_file_atomically(const std::string& path, std::span<const std::uint8_t> bytes) {
  write_file_atomically(
      path, std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
}

AtomicFolder::AtomicFolder(std::string target) : target_(std::move(target)) {
  while (target_.size() > 1 && target_.back() == '/') target_.pop_back();
  if (target_.empty()) throw OutputError("\"\"", "no folder name given");
  std::error_code error;
  if (fs::exists(fs::symlink_status(target_, error))) {
    make_folder(target_);  // or reports that it is not a folder
    if (!fs::is_empty(target_, error)) throw OutputError(target_, "is there already and not empty");
    fs::permissions(target_, fs::perms::owner_all, error);
    temporary_ = target_;
    return;
  }
  const std::string parent = folder_of(target_).string();
  make_folder(parent);
  remove_abandoned(parent);
  std::random_device random;
  for (int attempt = 0; attempt < 100; ++attempt) {
    const std::string path = temporary_name(target_, random);
    if (::mkdir(path.c_str(), 0700) != 0) {
      if (errno == EEXIST) continue;
      fail_to_write(target_, "cannot create the folder", errno);
    }
    FileDescriptor fd(::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    if (fd.get() < 0 || !take(fd.get())) continue;
    temporary_ = path;
    lock_ = fd.release();
    return;
  }
  throw OutputError(target_, "cannot find a free name for a temporary folder");
}

AtomicFolder::~AtomicFolder() {
  std::error_code error;
  if (!committed_ && temporary_ != target_) fs::remove_all(temporary_, error);
  if (!committed_ && temporary_ == target_) {
    for (fs::directory_iterator entry(target_, error), end; !error && entry != end;
         entry.increment(error)) {
      std::error_code ignored;
      fs::remove_all(entry->path(), ignored);
    }
  }
  if (lock_ >= 0) ::close(lock_);
}

void AtomicFolder::commit() {
  if (committed_) return;
  if (temporary_ != target_) {
    (void)::fsync(lock_);
    if (::rename(temporary_.c_str(), target_.c_str()) != 0)
      fail_to_write(target_, "cannot rename", errno);
    sync_folder(target_);
  }
  committed_ = true;
}

FileDescriptor lock_folder_of(const std::string& path_of_file) {
  std::error_code error;
  const fs::path real = fs::weakly_canonical(path_of_file, error);  // AtomicFile follows links
  const fs::path folder = folder_of(error ? path_of_file : real.string());
  FileDescriptor lock(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  while (lock.get() >= 0 && ::flock(lock.get(), LOCK_EX) != 0 && errno == EINTR) {
  }
  return lock;
}

void make_folder(const std::string& path) {
  if (path.empty()) throw OutputError("\"\"", "no folder name given");
  std::error_code error;
  fs::create_directories(path, error);
  std::error_code exists_error;
  if (fs::is_directory(path, exists_error)) return;
  if (fs::exists(path, exists_error)) throw OutputError(path, "exists and is not a folder");
  throw OutputError(path, "cannot create the folder: " + (error ? error : exists_error).message());
}

}  // namespace tarsier
