// SPDX-License-Identifier: MIT
#include "workspace.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_probe.h"

#include <fmt/format.h>

#include "router.h"
#include "verb_policy.h"
#include "workspace_paths.h"
#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

namespace tarsier::web {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr std::size_t kImageHeadBytes = 512U
                                        << 10U;  // bytes of an image that are read to get its size
constexpr auto kMeasureEvery = std::chrono::seconds(10);

// Bytes of all files below the folder; links are not followed.
std::uint64_t bytes_below(const std::string& folder) {
  std::uint64_t sum = 0;
  std::error_code error;
  fs::recursive_directory_iterator it(folder, fs::directory_options::skip_permission_denied, error);
  for (; !error && it != fs::recursive_directory_iterator(); it.increment(error)) {
    struct stat status {};
    if (::lstat(it->path().c_str(), &status) == 0) {
      sum += static_cast<std::uint64_t>(status.st_blocks) * 512;
    }
  }
  return sum;
}

double seconds_of(const struct timespec& time) {
  return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) * 1e-9;
}

}  // namespace

Workspace::Workspace(std::string folder, WorkspaceLimits limits) : limits_(limits) {
  std::error_code error;
  const bool is_new = !fs::exists(folder, error);
  make_folder(folder);
  if (is_new) fs::permissions(folder, fs::perms::owner_all, error);
  folder_ = fs::canonical(folder, error).string();
  if (error) throw OutputError(folder, error.message());
  for (const char* part : {"/.studio", "/.studio/uploads", "/.studio/thumbnails", "/.studio/runs",
                           "/.studio/sessions", "/sets", "/jobs", "/models"}) {
    const std::string path = folder_ + part;
    if (::mkdir(path.c_str(), 0700) != 0 && errno != EEXIST) {
      throw OutputError(path, std::strerror(errno));
    }
    if (!is_folder(path)) throw OutputError(path, "is not a folder");
  }
  const std::string lock = studio_folder() + "/lock";
  lock_ = ::open(lock.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (lock_ < 0) throw OutputError(lock, std::strerror(errno));
  if (::flock(lock_, LOCK_EX | LOCK_NB) != 0) {
    ::close(lock_);
    throw OutputError(folder_,
                      "another server uses this workspace; stop it, or give another "
                      "--workspace");
  }
  // Uploads, runs and sessions of a killed server are useless.
  for (const char* part : {"/uploads", "/runs", "/sessions"}) {
    for (const auto& entry : fs::directory_iterator(studio_folder() + part, error)) {
      fs::remove_all(entry.path(), error);
    }
  }
}

Workspace::~Workspace() {
  if (lock_ >= 0) ::close(lock_);
}

std::string Workspace::set_folder(const std::string& name) const {
  check_name("set", name);
  const std::string path = folder_ + "/sets/" + name;
  if (!is_folder(path)) throw HttpError(404, fmt::format("no set '{}'", name));
  return path;
}

std::vector<SetInfo> Workspace::sets() const {
  std::vector<SetInfo> sets;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_ + "/sets", error)) {
    const std::string path = entry.path().string();
    SetInfo set{entry.path().filename().string(), 0, 0};
    if (!is_good_name(set.name) || !is_folder(path)) continue;
    std::error_code inner;
    for (const auto& file : fs::directory_iterator(path, inner)) {
      struct stat status {};
      if (::lstat(file.path().c_str(), &status) != 0 || !S_ISREG(status.st_mode)) continue;
      if (!is_good_name(file.path().filename().string())) continue;
      ++set.files;
      set.bytes += static_cast<std::uint64_t>(status.st_size);
    }
    sets.push_back(std::move(set));
  }
  std::sort(sets.begin(), sets.end(),
            [](const SetInfo& a, const SetInfo& b) { return a.name < b.name; });
  return sets;
}

void Workspace::make_set(const std::string& name) {
  check_name("set", name);
  const std::lock_guard lock(mutex_);
  if (sets().size() >= limits_.sets) {
    throw HttpError(409, fmt::format("there are already {} sets; delete some", limits_.sets));
  }
  const std::string path = folder_ + "/sets/" + name;
  if (::mkdir(path.c_str(), 0700) != 0) {
    if (errno == EEXIST) throw HttpError(409, fmt::format("the set '{}' exists already", name));
    throw HttpError(507, fmt::format("the set cannot be made: {}", std::strerror(errno)));
  }
  sync_folder(path);
}

void Workspace::remove_set(const std::string& name) {
  const std::string path = set_folder(name);
  forget_thumbnails(path);
  const std::lock_guard lock(mutex_);
  std::error_code error;
  fs::remove_all(path, error);  // removes links, but not their targets
  measured_.reset();
  if (error) throw HttpError(500, fmt::format("the set cannot be deleted: {}", error.message()));
}

FileInfo Workspace::inspect(const std::string& path, const std::string& name) const {
  struct stat status {};
  if (::lstat(path.c_str(), &status) != 0 || !S_ISREG(status.st_mode)) {
    throw HttpError(404, fmt::format("no file '{}'", name));
  }
  const std::string mark =
      fmt::format("{} {} {}", status.st_size, status.st_mtim.tv_sec, status.st_mtim.tv_nsec);
  {
    const std::lock_guard lock(mutex_);
    const auto known = inspected_.find(path);
    if (known != inspected_.end() && known->second.first == mark) {
      FileInfo info = known->second.second;
      info.name = name;
      return info;
    }
  }
  FileInfo info;
  info.name = name;
  info.bytes = static_cast<std::uint64_t>(status.st_size);
  info.modified = seconds_of(status.st_mtim);
  const std::string head = head_of(path, kImageHeadBytes);
  if (const auto header = probe_image(bytes_of(head))) {
    info.type = FileType::kImage;
    info.width = header->width;
    info.height = header->height;
  } else if (is_video(name, head)) {
    info.type = FileType::kVideo;
  }
  const std::lock_guard lock(mutex_);
  if (inspected_.size() > 100'000) inspected_.clear();
  inspected_[path] = {mark, info};
  return info;
}

std::vector<FileInfo> Workspace::files(const std::string& set) const {
  const std::string folder = set_folder(set);
  std::vector<FileInfo> files;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    if (!is_good_name(name) || !is_file(entry.path().string())) continue;
    files.push_back(inspect(entry.path().string(), name));
  }
  std::sort(files.begin(), files.end(),
            [](const FileInfo& a, const FileInfo& b) { return a.name < b.name; });
  return files;
}

std::string Workspace::file_path(const std::string& set, const std::string& name) const {
  check_name("file", name);
  const std::string path = set_folder(set) + '/' + name;
  if (!is_file(path)) throw HttpError(404, fmt::format("no file '{}' in the set '{}'", name, set));
  return path;
}

FileInfo Workspace::file_info(const std::string& set, const std::string& name) const {
  return inspect(file_path(set, name), name);
}

FileInfo Workspace::store(const std::string& set, const std::string& name,
                          const std::string& spooled, bool replace) {
  check_name("file", name);
  const std::string folder = set_folder(set);
  struct stat status {};
  if (::lstat(spooled.c_str(), &status) != 0 || !S_ISREG(status.st_mode)) {
    throw HttpError(400, "the upload is empty");
  }
  const auto bytes = static_cast<std::uint64_t>(status.st_size);
  if (bytes > limits_.file_bytes) {
    throw HttpError(413, fmt::format("'{}' has {} MB; at most {} are accepted", name, bytes >> 20U,
                                     limits_.file_bytes >> 20U));
  }
  check_space(bytes);
  FileType type = FileType::kOther;
  const std::string refusal =
      upload_error(name, head_of(spooled, static_cast<std::size_t>(bytes)), limits_.pixels, type);
  if (!refusal.empty()) throw HttpError(415, fmt::format("'{}': {}", name, refusal));

  const int fd = ::open(spooled.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
  const bool synced = fd >= 0 && ::fsync(fd) == 0 && ::fchmod(fd, 0600) == 0;
  if (fd >= 0) ::close(fd);
  if (!synced)
    throw HttpError(507, fmt::format("'{}' cannot be written: {}", name, std::strerror(errno)));

  if (replace) forget_thumbnails(folder + '/' + name);
  const std::lock_guard lock(mutex_);
  std::size_t there = 0;
  std::error_code error;
  for (auto it = fs::directory_iterator(folder, error); !error && it != fs::directory_iterator();
       it.increment(error)) {
    ++there;
  }
  if (there >= limits_.files_of_set) {
    throw HttpError(409, fmt::format("the set has already {} files; make another", there));
  }
  std::string final_name = name;
  if (replace) {
    const std::string path = folder + '/' + final_name;
    if (is_folder(path) || ::rename(spooled.c_str(), path.c_str()) != 0) {
      throw HttpError(507, fmt::format("'{}' cannot be stored", name));
    }
  } else {
    const std::size_t dot = std::min(name.rfind('.'), name.size());
    for (int n = 2;; ++n) {
      if (::link(spooled.c_str(), (folder + '/' + final_name).c_str()) == 0) break;
      if (errno != EEXIST || n > 9999) {
        throw HttpError(507, fmt::format("'{}' cannot be stored: {}", name, std::strerror(errno)));
      }
      final_name = fmt::format("{} ({}){}", name.substr(0, dot), n, name.substr(dot));
      if (!is_good_name(final_name)) throw HttpError(409, fmt::format("'{}' exists already", name));
    }
    ::unlink(spooled.c_str());
  }
  sync_folder(folder + '/' + final_name);
  used_ += bytes;
  FileInfo info;
  info.name = final_name;
  info.bytes = bytes;
  info.type = type;
  if (::lstat((folder + '/' + final_name).c_str(), &status) == 0)
    info.modified = seconds_of(status.st_mtim);
  if (type == FileType::kImage) {
    if (const auto header =
            probe_image(bytes_of(head_of(folder + '/' + final_name, kImageHeadBytes)))) {
      info.width = header->width;
      info.height = header->height;
    }
  }
  return info;
}

void Workspace::remove_file(const std::string& set, const std::string& name) {
  const std::string path = file_path(set, name);
  forget_thumbnails(path);
  if (::unlink(path.c_str()) != 0) {
    throw HttpError(500, fmt::format("'{}' cannot be deleted: {}", name, std::strerror(errno)));
  }
  const std::lock_guard lock(mutex_);
  inspected_.erase(path);
  measured_.reset();
}

std::vector<FileInfo> Workspace::states() const {
  std::vector<FileInfo> files;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_, error)) {
    const std::string name = entry.path().filename().string();
    if (!is_good_name(name) || is_folder_name(name)) continue;
    if (is_file(entry.path().string())) files.push_back(inspect(entry.path().string(), name));
  }
  std::sort(files.begin(), files.end(),
            [](const FileInfo& a, const FileInfo& b) { return a.name < b.name; });
  return files;
}

std::string Workspace::state_path(const std::string& name) const {
  check_name("file", name);
  const std::string path = folder_ + '/' + name;
  if (is_folder_name(name) || !is_file(path)) {
    throw HttpError(404, fmt::format("no file '{}' in the workspace", name));
  }
  return path;
}

void Workspace::remove_state(const std::string& name) {
  const std::string path = state_path(name);
  // An SQLite file has journals beside it, and so has a set of annotations.
  for (const char* extension : {"-journal", "-wal", "-shm", ".journal"}) {
    ::unlink((path + extension).c_str());
  }
  if (::unlink(path.c_str()) != 0) {
    throw HttpError(500, fmt::format("'{}' cannot be deleted: {}", name, std::strerror(errno)));
  }
  const std::lock_guard lock(mutex_);
  measured_.reset();
}

Workspace::Space Workspace::space() const {
  Space space;
  space.quota = limits_.quota_bytes;
  {
    const std::lock_guard lock(mutex_);
    if (!measured_ || Clock::now() - *measured_ > kMeasureEvery) {
      // Uploads in progress are counted when they are stored.
      const std::uint64_t all = bytes_below(folder_);
      used_ = all - std::min(all, bytes_below(uploads_folder()));
      measured_ = Clock::now();
    }
    space.used = used_;
  }
  struct statvfs disk {};
  if (::statvfs(folder_.c_str(), &disk) == 0) {
    space.free = static_cast<std::uint64_t>(disk.f_bavail) * disk.f_frsize;
    space.total = static_cast<std::uint64_t>(disk.f_blocks) * disk.f_frsize;
  }
  return space;
}

void Workspace::check_space(std::uint64_t bytes) const {
  const Space now = space();
  if (now.used + bytes > now.quota) {
    throw HttpError(507, fmt::format("the workspace is full: {} of {} MB; delete sets or jobs",
                                     now.used / 1'000'000, now.quota / 1'000'000));
  }
  if (now.free < limits_.disk_reserve_bytes + bytes) {
    throw HttpError(507, fmt::format("the disk is nearly full: {} MB are free, of which {} stay "
                                     "reserved; delete sets or jobs",
                                     now.free / 1'000'000, limits_.disk_reserve_bytes / 1'000'000));
  }
}

}  // namespace tarsier::web
