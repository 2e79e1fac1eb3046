// SPDX-License-Identifier: MIT
#include "fuzz.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <stdexcept>
#include <system_error>
#include <unistd.h>

namespace tarsier::fuzz {
namespace {

namespace fs = std::filesystem;

std::string make_scratch_folder() {
  const char* requested = std::getenv("TARSIER_FUZZ_TMP");
  fs::path base = requested != nullptr ? requested : "/dev/shm";
  std::error_code error;
  if (!fs::is_directory(base, error)) base = fs::temp_directory_path();
  std::string name = base / "tarsier-fuzz-XXXXXX";
  if (mkdtemp(name.data()) == nullptr)
    throw std::system_error(errno, std::generic_category(), "no folder in " + base.string());
  return name;
}

}  // namespace

std::vector<Target>& targets() {
  static std::vector<Target> all;
  return all;
}

const Target* find_target(std::string_view name) {
  const auto found = std::find_if(targets().begin(), targets().end(),
                                  [&](const Target& target) { return target.name == name; });
  return found != targets().end() ? &*found : nullptr;
}

bool run_target(const Target& target, Bytes input) {
  set_log_level(LogLevel::kOff);
  try {
    target.run(input);
  } catch (const Error& error) {
    expect(*error.what() != '\0', "an error without a word");
    return false;
  }
  return true;
}

const std::string& scratch_folder() {
  struct Folder {
    std::string path = make_scratch_folder();
    ~Folder() {
      std::error_code error;
      fs::remove_all(path, error);
    }
  };
  static const Folder folder;
  return folder.path;
}

std::string file_of(Bytes bytes, std::string_view name) {
  std::string path = scratch_folder() + "/" + std::string(name);
  const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  if (file < 0) throw std::system_error(errno, std::generic_category(), path);
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t written = write(file, bytes.data() + done, bytes.size() - done);
    if (written < 0) throw std::system_error(errno, std::generic_category(), path);
    done += static_cast<std::size_t>(written);
  }
  close(file);
  return path;
}

std::string file_of(std::string_view text, std::string_view name) {
  return file_of(Bytes(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()), name);
}

std::vector<std::string_view> parts_of(Bytes bytes, std::size_t count) {
  constexpr std::string_view kBetween = "%%%\n";
  std::string_view rest = text_of(bytes);
  std::vector<std::string_view> parts;
  while (parts.size() + 1 < count) {
    const std::size_t end = rest.find(kBetween);
    parts.push_back(rest.substr(0, end));
    rest = end != std::string_view::npos ? rest.substr(end + kBetween.size()) : std::string_view();
  }
  parts.push_back(rest);
  return parts;
}

Pieces::Pieces(Bytes bytes, std::size_t max_size)
    : rest_(bytes), max_size_(max_size), state_(bytes.empty() ? 1U : bytes.front() + 1U) {}

Bytes Pieces::next() {
  state_ = state_ * 1664525U + 1013904223U;
  const Bytes piece = rest_.first(std::min(rest_.size(), 1 + (state_ >> 8U) % max_size_));
  rest_ = rest_.subspan(piece.size());
  return piece;
}

void expect(bool holds, const char* what) {
  if (!holds) throw std::logic_error(what);
}

}  // namespace tarsier::fuzz
