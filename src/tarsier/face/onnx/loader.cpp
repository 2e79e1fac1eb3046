// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/onnx/module.h"

#include <fmt/format.h>

#include <dlfcn.h>
#include <filesystem>
#include <system_error>

namespace tarsier::face::onnx {
namespace {

namespace fs = std::filesystem;

constexpr const char* kModule = "tarsier-onnx.so";

struct Module {
  std::string error;  // empty: loaded
  decltype(&tarsier_onnx_open) open = nullptr;
};

Module load() {
  Module module;
  const std::string path = module_path();
  if (path.empty()) {
    module.error = fmt::format(
        "ONNX files cannot be run: {} is not beside the program; install the package tarsier-onnx",
        kModule);
    return module;
  }
  // Never unloaded, because OpenCV registers exit handlers.
  void* handle = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (handle == nullptr) {
    const char* reason = dlerror();
    module.error =
        fmt::format("ONNX files cannot be run: {}", reason == nullptr ? path.c_str() : reason);
    return module;
  }
  const auto version =
      reinterpret_cast<decltype(&tarsier_onnx_version)>(dlsym(handle, "tarsier_onnx_version"));
  module.open = reinterpret_cast<decltype(&tarsier_onnx_open)>(dlsym(handle, "tarsier_onnx_open"));
  if (version == nullptr || module.open == nullptr) {
    module.error = fmt::format("{} is not a module of this program", path);
  } else if (const std::string built = version(); built != TARSIER_VERSION) {
    module.error =
        fmt::format("{} is of version {}, the program of {}", path, built, TARSIER_VERSION);
  }
  return module;
}

}  // namespace

std::string module_path() {
  std::error_code error;
  const fs::path folder = fs::read_symlink("/proc/self/exe", error).parent_path();
  for (const fs::path& candidate : {folder, folder / "../lib/tarsier", fs::path(TARSIER_MODULES)})
    if (fs::is_regular_file(candidate / kModule, error))
      return (candidate / kModule).lexically_normal();
  return {};
}

std::unique_ptr<Runner> open_runner(const Request& request, const std::string& path) {
  static const Module module = load();
  if (!module.error.empty()) throw ModelError(path, module.error);
  std::string error;
  std::unique_ptr<Runner> runner(module.open(&request, &error));
  if (runner == nullptr) throw ModelError(path, "OpenCV does not take it: " + error);
  return runner;
}

}  // namespace tarsier::face::onnx
