// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/errors.h"

#include <cstdlib>
#include <filesystem>
#include <string>
#include <system_error>

namespace tarsier::cli {

// A temporary folder, removed at the end of the benchmark. Throws OutputError.
class Scratch {
 public:
  Scratch() : path_((std::filesystem::temp_directory_path() / "tarsier-bench-XXXXXX").string()) {
    if (mkdtemp(path_.data()) == nullptr) throw OutputError(path_, "cannot be made");
  }
  ~Scratch() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  [[nodiscard]] std::string operator/(const std::string& name) const { return path_ + "/" + name; }

 private:
  std::string path_;
};

}  // namespace tarsier::cli
