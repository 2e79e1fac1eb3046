// SPDX-License-Identifier: MIT
#include "tarsier/media/input_files.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/still_source.h"

#include <fmt/format.h>

#include <sys/stat.h>

namespace tarsier {
namespace {

std::vector<std::string> files_of(const std::string& input, const std::vector<Scheme>& schemes) {
  try {
    switch (classify_source(input, schemes)) {
      case SourceKind::kFolder:
        return images_in_folder(input);
      case SourceKind::kGlob:
        return files_of_glob(input);
      case SourceKind::kList:
        return paths_of_list(input.substr(1));
      default:
        return {input};
    }
  } catch (const InputError&) {  // reported when the input is opened
    return {};
  }
}

}  // namespace

InputFiles::InputFiles(const std::vector<std::string>& inputs, const std::vector<Scheme>& schemes) {
  for (const std::string& input : inputs)
    for (const std::string& path : files_of(input, schemes)) add(path);
}

void InputFiles::add(const std::string& path) {
  struct ::stat info {};
  if (::stat(path.c_str(), &info) != 0 || !S_ISREG(info.st_mode)) return;
  paths_.push_back(path);
  identities_.emplace(info.st_dev, info.st_ino);
}

bool InputFiles::contains(const std::string& path) const {
  struct ::stat info {};
  return ::stat(path.c_str(), &info) == 0 && identities_.contains({info.st_dev, info.st_ino});
}

void InputFiles::refuse_output(const std::string& output) const {
  if (!output.empty() && contains(output))
    throw UsageError(fmt::format("{}: is also an input; name another output", output));
}

}  // namespace tarsier
