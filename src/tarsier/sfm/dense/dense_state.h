// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

// Records of finished work, so that the next run can skip it. Internal to this module.
namespace tarsier::sfm {

// Reads the record of finished work; null where there is none with this digest.
[[nodiscard]] nlohmann::json read_state(const std::string& path, std::string_view digest);

// Writes a record, completely or not at all, and creates its folder. Throws OutputError.
void write_state(const std::string& path, std::string_view digest, nlohmann::json record);

// Removes a record before the work that it describes is overwritten. Throws OutputError.
void remove_state(const std::string& path);

// Digest of everything that a piece of work depends on, added part by part.
class Digest {
 public:
  void add(std::string_view text);
  void add(double number);
  [[nodiscard]] std::string hex() const;

 private:
  std::string text_;
};

}  // namespace tarsier::sfm
