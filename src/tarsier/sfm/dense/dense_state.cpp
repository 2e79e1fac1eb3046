// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/dense_state.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/sha256.h"

#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>

namespace tarsier::sfm {
namespace {

constexpr std::int64_t kMaxStateBytes = 100'000'000;

}  // namespace

nlohmann::json read_state(const std::string& path, std::string_view digest) {
  try {
    nlohmann::json record = parse_json(read_file(path, kMaxStateBytes), path);
    if (record.is_object() && record.value("digest", nlohmann::json()) == digest) return record;
  } catch (const InputError&) {  // missing, or not a record
  }
  return nullptr;
}

void write_state(const std::string& path, std::string_view digest, nlohmann::json record) {
  record["digest"] = digest;
  make_folder(std::filesystem::path(path).parent_path().string());
  write_file_atomically(path, record.dump() + "\n");
}

void remove_state(const std::string& path) {
  std::error_code error;
  std::filesystem::remove(path, error);
  if (error) throw OutputError(path, "cannot remove: " + error.message());
}

void Digest::add(std::string_view text) { text_ += fmt::format("{}:{}\n", text.size(), text); }

void Digest::add(double number) { text_ += fmt::format("{}\n", number); }

std::string Digest::hex() const {
  Sha256 sum;
  sum.add(text_);
  return sum.hex();
}

}  // namespace tarsier::sfm
