// SPDX-License-Identifier: MIT
// fuzz_replay FOLDER..: runs each target on the files of FOLDER/TARGET, as a test of any build.
// Files whose names begin with "good" must be accepted; each target needs an input.
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
  try {
    const bool is_accepted = tarsier::fuzz::run_target(target, read(path));
    if (is_accepted || !path.filename().string().starts_with("good")) return true;
    std::printf("%s: refused\n", path.c_str());
  } catch (const std::exception& error) {
    std::printf("%s: %s\n", path.c_str(), error.what());
  }
  return false;
}

}  // namespace

int main(int argc, char** argv) {
  bool all = true;
  for (const auto& target : tarsier::fuzz::targets()) {
    std::vector<fs::path> files;
    for (int k = 1; k < argc; ++k) {
      const fs::path folder = fs::path(argv[k]) / target.name;
      if (!fs::is_directory(folder)) continue;
      for (const auto& entry : fs::directory_iterator(folder)) files.push_back(entry.path());
    }
    std::sort(files.begin(), files.end());
    // Printed before the run: after a crash the last line names the target.
    std::printf("%s: %zu inputs\n", std::string(target.name).c_str(), files.size());
    std::fflush(stdout);
    all = !files.empty() && all;
    for (const fs::path& path : files) all = holds(target, path) && all;
  }
  return all ? 0 : 1;
}
