// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"

#include <fmt/format.h>

#include "module.h"
#include "pipe_window.h"
#include <cstdlib>
#include <dlfcn.h>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::window {
namespace {

namespace fs = std::filesystem;

constexpr const char* kModule = "tarsier-window.so";

struct Module {
  decltype(&tarsier_window_check_display) check_display = nullptr;
  decltype(&tarsier_window_open) open = nullptr;
};

[[noreturn]] void fail(const std::string& message) { throw Error(ErrorKind::kInput, message); }

bool is_set(const char* variable) {
  const char* value = std::getenv(variable);
  return value != nullptr && *value != '\0';
}

template <typename Function>
Function* symbol(void* handle, const char* name, const fs::path& path) {
  void* address = dlsym(handle, name);
  if (address == nullptr)
    fail(fmt::format("{}: not a window module of this program", path.string()));
  return reinterpret_cast<Function*>(address);
}

Module load() {
  std::error_code error;
  const fs::path folder = fs::read_symlink("/proc/self/exe", error).parent_path();
  fs::path path;
  for (const fs::path& place : {folder / kModule, folder / "../lib/tarsier" / kModule}) {
    if (fs::is_regular_file(place, error)) {
      path = place.lexically_normal();
      break;
    }
  }
  if (path.empty()) {
    fail(fmt::format(
        "no window: {} is not next to the program; install the package tarsier-gui, or give -o OUT",
        kModule));
  }
  // Never unloaded: the toolkit leaves exit handlers behind.
  void* handle = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (handle == nullptr) {
    const char* reason = dlerror();
    fail(fmt::format("no window: {} (install the package tarsier-gui, or give -o OUT)",
                     reason == nullptr ? path.c_str() : reason));
  }
  const std::string version =
      symbol<decltype(tarsier_window_version)>(handle, "tarsier_window_version", path)();
  if (version != TARSIER_VERSION) {
    fail(fmt::format("{}: version {}, but the program is {}; install the same version of both",
                     path.string(), version, TARSIER_VERSION));
  }
  return {
      symbol<decltype(tarsier_window_check_display)>(handle, "tarsier_window_check_display", path),
      symbol<decltype(tarsier_window_open)>(handle, "tarsier_window_open", path)};
}

const Module& module() {
  static const Module loaded = [] {
    // Checked before the toolkit is loaded: a missing display is common over ssh.
    if (!is_set("DISPLAY") && !is_set("WAYLAND_DISPLAY")) {
      fail(
          "no display: DISPLAY is not set; run on a desktop or in a browser (tarsier serve), or "
          "give -o OUT");
    }
    Module result = load();
    result.check_display();
    return result;
  }();
  return loaded;
}

// The pipe in the environment, if there is one. The variable is removed, because other programs
// that this one starts do not have these descriptors.
const std::optional<PipeEnds>& pipe() {
  static const std::optional<PipeEnds> ends = []() -> std::optional<PipeEnds> {
    if (!is_set(kPipeVariable)) return std::nullopt;
    const PipeEnds found = parse_pipe_ends(std::getenv(kPipeVariable));
    unsetenv(kPipeVariable);
    return found;
  }();
  return ends;
}

}  // namespace

void prepare() {
  if (!pipe()) static_cast<void>(module());
}

bool shows_status() {
  prepare();
  return pipe().has_value();
}

bool supports_stages() {
  // The variable exists until prepare() has read it.
  return is_set(kPipeVariable) || pipe().has_value();
}

std::unique_ptr<Window> open_window(const WindowOptions& options) {
  if (pipe()) return make_pipe_window(*pipe(), options);
  return std::unique_ptr<Window>(module().open(&options));
}

}  // namespace tarsier::window
