// SPDX-License-Identifier: MIT
#include "tarsier/media/model_store.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/user_models.h"

#include <cstdlib>
#include <filesystem>
#include <system_error>
#include <utility>

namespace tarsier {
namespace {

namespace fs = std::filesystem;

// The folder that comes with the program that runs; empty where there is none.
std::string folder_of_program() {
  const fs::path program = program_folder();
  if (program.empty()) return {};
  std::error_code error;
  for (const fs::path& place : {program / "../../../models", program / "../share/tarsier/models",
                                program / "../../share/tarsier/models"}) {
    if (fs::is_directory(place, error)) return place.lexically_normal().string();
  }
  return {};
}

// Where `name` is in a folder of models, or would be.
fs::path place_in(const std::string& folder, std::string_view name) {
  const fs::path place = fs::path(folder) / name;
  std::error_code error;
  if (fs::exists(place, error) || folder != folder_of_program()) return place;
  const std::string own = user_models_folder();
  if (own.empty() || !fs::exists(fs::path(own) / name, error)) return place;
  return fs::path(own) / name;
}

}  // namespace

std::string user_models_folder() {
  const char* data = std::getenv("XDG_DATA_HOME");
  if (data != nullptr && *data == '/') return std::string(data) + "/tarsier/models";
  const char* home = std::getenv("HOME");
  if (home == nullptr || *home != '/') return {};
  return std::string(home) + "/.local/share/tarsier/models";
}

std::string program_folder() {
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  return error ? std::string() : program.parent_path().string();
}

ModelStore::ModelStore(std::string folder) : folder_(std::move(folder)) {
  std::error_code error;
  if (!fs::is_directory(folder_, error)) throw InputError(folder_, "no such folder of models");
}

ModelStore ModelStore::find(const std::string& folder) {
  if (!folder.empty()) return ModelStore(folder);
  const char* environment = std::getenv("TARSIER_MODELS");
  if (environment != nullptr && *environment != '\0') return ModelStore(environment);
  const std::string own = folder_of_program();
  return own.empty() ? ModelStore() : ModelStore(own);
}

bool ModelStore::has(std::string_view name) const {
  std::error_code error;
  return !folder_.empty() && fs::exists(place_in(folder_, name), error);
}

std::string ModelStore::place_of(std::string_view name) const {
  return folder_.empty() ? std::string(name) : place_in(folder_, name).string();
}

std::string ModelStore::path(std::string_view name) const {
  if (folder_.empty()) {
    throw ModelError(std::string(name), "no folder of models was found: set TARSIER_MODELS to it");
  }
  if (!has(name)) {
    throw ModelError(place_of(name),
                     "is missing from the folder of models: put it there, set TARSIER_MODELS to a "
                     "folder that has it, or name a file of your own");
  }
  return place_of(name);
}

std::string ModelStore::path_or(const std::string& given, std::string_view name) const {
  return given.empty() ? path(name) : given;
}

}  // namespace tarsier
