// SPDX-License-Identifier: MIT
#include "audit_log.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include "router.h"
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <deque>
#include <fcntl.h>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sys/stat.h>
#include <unistd.h>

namespace tarsier::web {
namespace {

constexpr off_t kMaxBytes = 4 << 20;
constexpr std::size_t kMaxLoggedText = 300;

}  // namespace

AuditLog::AuditLog(std::string path) : path_(std::move(path)) {}

void AuditLog::write(std::string_view event, std::string_view address,
                     const nlohmann::json& details) {
  nlohmann::json line = details.is_object() ? details : nlohmann::json::object();
  for (auto& value : line) {
    if (value.is_string() && value.get_ref<const std::string&>().size() > kMaxLoggedText)
      value = value.get_ref<const std::string&>().substr(0, kMaxLoggedText);
  }
  line["time"] = fmt::format(
      "{:%Y-%m-%dT%H:%M:%S}Z",
      fmt::gmtime(std::chrono::system_clock::to_time_t(std::chrono::system_clock::now())));
  line["event"] = event;
  if (!address.empty()) line["address"] = address;
  const std::string text = to_text(line) + "\n";

  const std::lock_guard lock(mutex_);
  struct stat state {};
  if (::stat(path_.c_str(), &state) == 0 && state.st_size > kMaxBytes)
    (void)std::rename(path_.c_str(), (path_ + ".1").c_str());
  const int fd =
      ::open(path_.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  // A single write(), so that lines of two programs do not mix.
  const bool done =
      fd >= 0 && ::write(fd, text.data(), text.size()) == static_cast<ssize_t>(text.size());
  const int error = errno;
  if (fd >= 0) ::close(fd);
  if (!done) log_warning("{}: the audit log cannot be written: {}", path_, errno_text(error));
}

std::vector<nlohmann::json> AuditLog::last(std::size_t count) const {
  const std::lock_guard lock(mutex_);
  std::deque<nlohmann::json> lines;
  for (const std::string& path : {path_ + ".1", path_}) {
    std::ifstream file(path);
    std::string text;
    while (std::getline(file, text)) {
      nlohmann::json line = nlohmann::json::parse(text, nullptr, false);
      if (!line.is_object()) continue;
      lines.push_back(std::move(line));
      if (lines.size() > count) lines.pop_front();
    }
  }
  return {lines.begin(), lines.end()};
}

}  // namespace tarsier::web
