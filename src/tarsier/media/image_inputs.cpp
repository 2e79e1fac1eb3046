// SPDX-License-Identifier: MIT
#include "tarsier/media/image_inputs.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/still_source.h"

#include <filesystem>
#include <system_error>

namespace tarsier {
namespace {

[[noreturn]] void refuse(const std::string& input) {
  throw InputError(masked(input),
                   "is not an image: expected images, folders, globs or @lists of images");
}

// Whether a file of a glob or list is a video.
bool is_video(const std::string& path) {
  std::error_code ignored;
  if (has_image_extension(path) || !std::filesystem::is_regular_file(path, ignored)) return false;
  try {
    return classify_source(path) == SourceKind::kVideo;
  } catch (const InputError&) {  // reported when it is read
    return false;
  }
}

}  // namespace

std::vector<std::string> images_of_inputs(const std::vector<std::string>& inputs,
                                          const std::vector<Scheme>& schemes) {
  std::vector<std::string> images;
  const auto add = [&](const std::vector<std::string>& paths) {
    for (const std::string& path : paths) {
      if (is_video(path)) refuse(path);
      images.push_back(path);
    }
  };
  for (const std::string& input : inputs) {
    switch (classify_source(input, schemes)) {
      case SourceKind::kImage:
        images.push_back(input);
        break;
      case SourceKind::kFolder:
        add(images_in_folder(input));
        break;
      case SourceKind::kGlob:
        add(files_of_glob(input));
        break;
      case SourceKind::kList:
        add(paths_of_list(input.substr(1)));
        break;
      default:
        refuse(input);
    }
  }
  return images;
}

}  // namespace tarsier
