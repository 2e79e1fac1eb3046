// SPDX-License-Identifier: MIT
#include "job_lines.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/media/atomic_file.h"

#include "jobs.h"
#include "router.h"
#include <algorithm>
#include <fcntl.h>
#include <nlohmann/json.hpp>
#include <sys/stat.h>
#include <unistd.h>

namespace tarsier::web {

namespace {

using Json = nlohmann::json;

}  // namespace

void BoundedFile::open(const std::string& path, std::uint64_t max_bytes, bool truncate) {
  close();
  fd_ = ::open(path.c_str(),
               O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC | O_NOFOLLOW | (truncate ? O_TRUNC : 0),
               0600);
  struct stat status {};
  written_ =
      fd_ >= 0 && ::fstat(fd_, &status) == 0 ? static_cast<std::uint64_t>(status.st_size) : 0;
  max_bytes_ = max_bytes;
}

void BoundedFile::add(std::string_view line) {
  if (fd_ < 0 || written_ > max_bytes_) return;
  std::string text(line);
  text += '\n';
  if (written_ + text.size() > max_bytes_) text = "(further lines were dropped)\n";
  written_ += text.size() + (text.front() == '(' ? max_bytes_ : 0);
  try {
    write_all(fd_, text, "job");
  } catch (const Error& error) {
    log_warning("a job's lines: {}", error.what());
    written_ = max_bytes_ + 1;
  }
}

void BoundedFile::close() {
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
}

std::deque<std::string> tail_of(const std::string& path, std::size_t lines) {
  std::deque<std::string> tail;
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
  if (fd < 0) return tail;
  constexpr off_t kTail = 256 << 10;
  const off_t size = ::lseek(fd, 0, SEEK_END);
  const off_t from = std::max<off_t>(0, size - kTail);
  std::string text(static_cast<std::size_t>(size - from), '\0');
  const ssize_t count = ::pread(fd, text.data(), text.size(), from);
  ::close(fd);
  text.resize(static_cast<std::size_t>(std::max<ssize_t>(0, count)));
  std::size_t at = from > 0 ? std::min(text.find('\n'), text.size() - 1) + 1 : 0;
  while (at < text.size()) {
    const std::size_t end = text.find('\n', at);
    if (end == std::string::npos) break;  // truncated by a kill
    tail.push_back(text.substr(at, end - at));
    if (tail.size() > lines) tail.pop_front();
    at = end + 1;
  }
  return tail;
}

std::string shortened(const std::string& line) {
  constexpr std::size_t kMaxListLength = 500;
  const Json whole = Json::parse(line, nullptr, false);
  if (!whole.is_object()) return {};
  Json object = whole;
  for (const auto& [name, value] : whole.items()) {
    if (!value.is_array() || value.size() <= kMaxListLength) continue;
    object[name] = Json(std::vector<Json>(value.begin(), value.begin() + kMaxListLength));
    object[name + "_count"] = value.size();
  }
  return to_text(object);
}

std::optional<Json> progress_of(std::string_view line) {
  if (!line.starts_with("{\"progress\":")) return std::nullopt;
  const Json json = Json::parse(line, nullptr, false);
  if (!json.is_object() || !json["progress"].is_string()) return std::nullopt;
  const auto number = [&](const char* name) {
    return json.contains(name) && json[name].is_number() ? json[name] : Json(nullptr);
  };
  const bool has_unit = json.contains("unit") && json["unit"].is_string();
  Json progress = {{"label", json["progress"]},
                   {"done", number("done")},
                   {"total", number("total")},
                   {"unit", has_unit ? json["unit"] : Json("")}};
  for (const auto& [name, value] : json.items()) {
    const bool is_ours = name == "done" || name == "total" || name == "seconds";
    if (!is_ours && value.is_number()) progress["values"][name] = value;
  }
  return progress;
}

}  // namespace tarsier::web
