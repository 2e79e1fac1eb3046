// SPDX-License-Identifier: MIT
#include "workspace_paths.h"

#include "tarsier/core/log.h"

#include <fmt/format.h>

#include "router.h"
#include "verb_policy.h"
#include <algorithm>
#include <array>
#include <cctype>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

namespace tarsier::web {

void check_name(std::string_view what, const std::string& name) {
  if (is_good_name(name)) return;
  throw HttpError(400, fmt::format("'{}' is not a valid name of a {}: letters, digits, spaces and "
                                   "- _ . ( ), at most 120 bytes, no / * ? [ ] and no . at the "
                                   "beginning",
                                   printable(name.substr(0, 100)), what));
}

bool is_folder_name(std::string_view name) {
  return name == "sets" || name == "jobs" || name == "models";
}

bool is_link(const std::string& path) {
  struct stat status {};
  return ::lstat(path.c_str(), &status) == 0 && S_ISLNK(status.st_mode);
}
bool is_folder(const std::string& path) {
  struct stat status {};
  return ::lstat(path.c_str(), &status) == 0 && S_ISDIR(status.st_mode);
}
bool is_file(const std::string& path) {
  struct stat status {};
  return ::lstat(path.c_str(), &status) == 0 && S_ISREG(status.st_mode);
}

std::string head_of(const std::string& path, std::size_t max_bytes) {
  std::string bytes;
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  if (fd < 0) return bytes;
  bytes.resize(max_bytes);
  std::size_t done = 0;
  while (done < max_bytes) {
    const ssize_t count = ::read(fd, bytes.data() + done, max_bytes - done);
    if (count <= 0) break;
    done += static_cast<std::size_t>(count);
  }
  ::close(fd);
  bytes.resize(done);
  return bytes;
}

std::span<const std::uint8_t> bytes_of(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

}  // namespace tarsier::web
