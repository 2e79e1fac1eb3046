// SPDX-License-Identifier: MIT
// fuzz_replay TARGET FOLDER..: runs a target on all files of the folders, as a test of any build.
// Files whose names begin with "good" must be taken. fuzz_replay --list names the targets.
#include "fuzz.h"
#include <algorithm>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

std::vector<std::uint8_t> read(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

bool holds(const tarsier::fuzz::Target& target, const fs::path& path) {
  const std::string name = path.filename().string();
  try {
    const bool taken = tarsier::fuzz::run_target(target, read(path));
    if (!taken && name.starts_with("good")) {
      std::printf("%s: refused\n", path.c_str());
      return false;
    }
    return true;
  } catch (const std::exception& error) {
    std::printf("%s: %s\n", path.c_str(), error.what());
    return false;
  }
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> words(argv + 1, argv + argc);
  if (words.empty() || words[0] == "--list") {
    for (const auto& target : tarsier::fuzz::targets())
      std::printf("%s\n", std::string(target.name).c_str());
    return 0;
  }
  const auto* target = tarsier::fuzz::find_target(words[0]);
  if (target == nullptr) {
    std::printf("no target %s\n", words[0].c_str());
    return 2;
  }
  std::vector<fs::path> files;
  for (std::size_t k = 1; k < words.size(); ++k) {
    if (!fs::is_directory(words[k])) continue;
    for (const auto& entry : fs::directory_iterator(words[k])) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  bool all = !files.empty();
  if (files.empty()) std::printf("no inputs for %s\n", words[0].c_str());
  for (const fs::path& path : files) all = holds(*target, path) && all;
  std::printf("%zu inputs\n", files.size());
  return all ? 0 : 1;
}
