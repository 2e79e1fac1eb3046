// SPDX-License-Identifier: MIT
#include "framework/companion.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/model_store.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <unistd.h>
#include <vector>

namespace tarsier::cli {
namespace {

std::string path_of(const std::string& name) {
  const std::filesystem::path folder = program_folder();
  const std::string sibling = (folder / name).string();
  for (const std::string& path :
       {sibling, (folder.parent_path() / "libexec/tarsier" / name).string()}) {
    if (::access(path.c_str(), X_OK) == 0) return path;
  }
  throw InputError(sibling, fmt::format("no such program; build the target {}, or install it in "
                                        "../libexec/tarsier of tarsier's folder",
                                        name));
}

}  // namespace

void become_companion(const std::string& name, std::span<const std::string> words) {
  const std::string path = path_of(name);
  std::vector<char*> arguments;
  const auto add = [&](const std::string& word) {
    arguments.push_back(const_cast<char*>(word.c_str()));  // execv does not change them
  };
  add(name);
  for (const std::string& word : words) add(word);
  arguments.push_back(nullptr);
  // Until the other program handles signals itself, a signal either stays pending for it, or our
  // signal thread takes it and ends the process.
  const EndOnSignals at_once;
  throw_if_stopped(stop_on_signals());
  std::fflush(stdout);
  ::execv(path.c_str(), arguments.data());
  throw InputError(path, fmt::format("cannot be started: {}", std::strerror(errno)));
}

}  // namespace tarsier::cli
