// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include "ui/face/annotate_state.h"
#include <cerrno>
#include <cstdio>
#include <fcntl.h>
#include <nlohmann/json.hpp>
#include <string_view>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

namespace tarsier {
namespace {

using nlohmann::json;

constexpr std::int64_t kMaxBytes = 1'000'000'000;
constexpr mode_t kMode = 0644;

void write_synced(int fd, const json& record, const std::string& path) {
  const std::string line = record.dump(-1, ' ', false, json::error_handler_t::replace) + "\n";
  write_all(fd, line, path);
  if (::fsync(fd) != 0) throw OutputError(path, errno_text(errno));
}

}  // namespace

AnnotateJournal::~AnnotateJournal() { close(); }

void AnnotateJournal::close() {
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
}

std::vector<json> AnnotateJournal::open() {
  close();
  lines_ = 0;
  fd_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC | O_NOFOLLOW, kMode);
  if (fd_ < 0) throw OutputError(path_, errno_text(errno));
  if (::flock(fd_, LOCK_EX | LOCK_NB) != 0) {
    close();
    throw InputError(path_, "another program is annotating this set");
  }
  sync_folder(path_);
  const std::string text = read_file(path_, kMaxBytes);
  std::vector<json> records;
  std::size_t good = 0;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = text.find('\n', begin);
    if (end == std::string::npos) break;  // incomplete: the program was killed while writing it
    const std::string name = fmt::format("{}: line {}", path_, records.size() + 1);
    try {
      records.push_back(parse_json(std::string_view(text).substr(begin, end - begin), name));
    } catch (const Error& error) {
      // The machine went down while writing the last line.
      if (text.find('\n', end + 1) != std::string::npos || end + 1 < text.size())
        throw InputError(path_, fmt::format("line {} is damaged; repair it or move the file away",
                                            records.size() + 1));
      break;
    }
    begin = end + 1;
    good = begin;
  }
  if (good < text.size() && ::ftruncate(fd_, static_cast<off_t>(good)) != 0)
    throw OutputError(path_, errno_text(errno));
  lines_ = static_cast<int>(records.size());
  return records;
}

void AnnotateJournal::append(const json& record) {
  if (fd_ < 0) {
    fd_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC | O_NOFOLLOW, kMode);
    if (fd_ < 0) throw OutputError(path_, errno_text(errno));
    sync_folder(path_);
  }
  write_synced(fd_, record, path_);
  ++lines_;
}

void AnnotateJournal::restart(const std::optional<json>& record) {
  if (!record) {
    if (::unlink(path_.c_str()) != 0 && errno != ENOENT)
      throw OutputError(path_, errno_text(errno));
    sync_folder(path_);
    close();
    lines_ = 0;
    return;
  }
  // A new file, locked before it gets its final name.
  const std::string next = path_ + ".new";
  const int fd =
      ::open(next.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_APPEND | O_CLOEXEC | O_NOFOLLOW, kMode);
  if (fd < 0) throw OutputError(next, errno_text(errno));
  try {
    (void)::flock(fd, LOCK_EX | LOCK_NB);
    write_synced(fd, *record, next);
    if (::rename(next.c_str(), path_.c_str()) != 0) throw OutputError(path_, errno_text(errno));
  } catch (...) {
    ::close(fd);
    ::unlink(next.c_str());
    throw;
  }
  sync_folder(path_);
  close();
  fd_ = fd;
  lines_ = 1;
}

}  // namespace tarsier
