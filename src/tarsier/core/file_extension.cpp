// SPDX-License-Identifier: MIT
#include "tarsier/core/file_extension.h"

#include "tarsier/core/words.h"

#include <filesystem>

namespace tarsier {

std::string lowercase_extension(std::string_view path) {
  return lower_case(std::filesystem::path(path).extension().string());
}

}  // namespace tarsier
