// SPDX-License-Identifier: MIT
#include "framework/journal.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/json_integer.h"

#include <fmt/format.h>

#include "framework/output.h"
#include <cerrno>
#include <fcntl.h>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <sys/file.h>
#include <unistd.h>
#include <utility>

namespace tarsier::cli {
namespace {

std::string text_of(const JournalEntry& entry) {
  nlohmann::ordered_json json{{"input", entry.input}};
  if (!entry.skipped.empty()) {
    json["skipped"] = entry.skipped;
  } else {
    json["line"] = entry.line;
    if (!entry.rows.empty()) json["rows"] = entry.rows;
  }
  return json_text(json);
}

std::optional<JournalEntry> entry_of(const std::string& text) {
  try {
    const nlohmann::json json = nlohmann::json::parse(text);
    JournalEntry entry;
    entry.input = json_integer<std::int64_t>(json.at("input"));
    entry.skipped = json.value("skipped", "");
    entry.line = json.value("line", "");
    entry.rows = json.value("rows", std::vector<std::string>());
    return entry;
  } catch (const nlohmann::json::exception&) {
    return std::nullopt;
  }
}

[[noreturn]] void fail(const std::string& path, int error) {
  throw OutputError(path, "cannot write: " + errno_text(error));
}

}  // namespace

Journal::Journal(std::string path, const std::string& header, bool resume)
    : path_(std::move(path)) {
  fd_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (fd_ < 0) fail(path_, errno);
  if (::flock(fd_, LOCK_EX | LOCK_NB) != 0) {
    ::close(fd_);
    throw OutputError(path_, "another program is writing it");
  }
  try {
    if (resume) read_entries(header);
    if (::ftruncate(fd_, end_) != 0 || ::lseek(fd_, end_, SEEK_SET) < 0) fail(path_, errno);
    if (end_ == 0) {
      write_all(fd_, header + '\n', path_);
      end_ = static_cast<std::int64_t>(header.size()) + 1;
    }
  } catch (...) {
    ::close(fd_);
    throw;
  }
}

Journal::~Journal() { ::close(fd_); }

void Journal::read_entries(const std::string& header) {
  std::ifstream file(path_, std::ios::binary);
  std::string line;
  const auto next = [&] { return std::getline(file, line) && !file.eof(); };  // only complete lines
  if (!next()) return;
  if (line != header) {
    throw InputError(
        path_,
        "was written with other inputs, flags or another shard: omit --resume to start again");
  }
  end_ = static_cast<std::int64_t>(line.size()) + 1;
  while (next()) {
    const std::optional<JournalEntry> entry = entry_of(line);
    if (!entry) break;  // incomplete after a power cut
    const auto size = static_cast<std::int64_t>(line.size()) + 1;
    locations_[entry->input] = {end_, size};
    end_ += size;
  }
}

void Journal::add(const JournalEntry& entry) {
  const std::string text = text_of(entry) + '\n';
  write_all(fd_, text, path_);
  const auto size = static_cast<std::int64_t>(text.size());
  locations_[entry.input] = {end_, size};
  end_ += size;
}

std::set<std::int64_t> Journal::inputs() const {
  std::set<std::int64_t> inputs;
  for (const auto& [input, location] : locations_) inputs.insert(inputs.end(), input);
  return inputs;
}

std::string Journal::text_at(const Location& location) const {
  std::string text(static_cast<std::size_t>(location.size), '\0');
  std::size_t read = 0;
  while (read < text.size()) {
    const ssize_t bytes = ::pread(fd_, text.data() + read, text.size() - read,
                                  location.begin + static_cast<std::int64_t>(read));
    if (bytes < 0 && errno == EINTR) continue;
    if (bytes <= 0) throw InputError(path_, "cannot be read any more");
    read += static_cast<std::size_t>(bytes);
  }
  return text;
}

void Journal::read(const std::function<void(const JournalEntry&)>& callback) const {
  for (const auto& [input, location] : locations_) {
    const std::optional<JournalEntry> entry = entry_of(text_at(location));
    if (!entry) throw InputError(path_, "was changed while it was written");
    callback(*entry);
  }
}

void Journal::remove() { ::unlink(path_.c_str()); }

}  // namespace tarsier::cli
