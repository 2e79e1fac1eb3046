// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

// What a run remembers, so that the next one does not do it again. Internal to this module.
namespace tarsier::sfm {

// The record of finished work in a file, or null where there is none with this digest.
[[nodiscard]] nlohmann::json read_state(const std::string& path, std::string_view digest);

// Writes it, whole or not at all, and makes the folder. Throws OutputError.
void write_state(const std::string& path, std::string_view digest, nlohmann::json record);

// Text that the digest of work is made of: what it depends on, part by part.
class Digest {
 public:
  void add(std::string_view text);
  void add(double number);
  [[nodiscard]] std::string hex() const;

 private:
  std::string text_;
};

}  // namespace tarsier::sfm
