// SPDX-License-Identifier: MIT
#include "ui/save_image.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <filesystem>

namespace tarsier {

std::string save_numbered(const std::string& folder, const cv::Mat& image) {
  make_folder(folder);
  for (int number = 1;; ++number) {
    const std::filesystem::path path =
        std::filesystem::path(folder) / fmt::format("tarsier-{:04}.png", number);
    std::error_code error;
    if (std::filesystem::symlink_status(path, error).type() !=
        std::filesystem::file_type::not_found) {
      if (error) throw OutputError(path.string(), error.message());
      continue;
    }
    write_image(path.string(), image);
    return path.string();
  }
}

}  // namespace tarsier
