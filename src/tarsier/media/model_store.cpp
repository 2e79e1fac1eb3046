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

// The folder that comes with the running program; empty if there is none.
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
  if (!fs::is_directory(folder_, error)) throw ModelError(folder_, "no such folder of models");
}

ModelStore ModelStore::find(const std::string& folder) {
  if (!folder.empty()) return ModelStore(folder);
  ModelStore store = find_shipped();
  const char* own = std::getenv("TARSIER_OWN_MODELS");
  if (own != nullptr) store.own_folder_ = own;
  return store;
}

ModelStore ModelStore::find_shipped() {
  const char* environment = std::getenv("TARSIER_MODELS");
  if (environment != nullptr && *environment != '\0') return ModelStore(environment);
  const std::string with_program = folder_of_program();
  if (with_program.empty()) return {};
  ModelStore store(with_program);
  store.user_folder_ = user_models_folder();
  return store;
}

ModelStore ModelStore::shipped() const {
  ModelStore store = *this;
  store.own_folder_.clear();
  return store;
}

bool ModelStore::is_own(std::string_view name) const {
  std::error_code error;
  return !own_folder_.empty() && fs::exists(fs::path(own_folder_) / name, error);
}

bool ModelStore::has(std::string_view name) const {
  std::error_code error;
  if (is_own(name)) return true;
  return !folder_.empty() && fs::exists(expected_path(name), error);
}

std::string ModelStore::expected_path(std::string_view name) const {
  if (is_own(name)) return (fs::path(own_folder_) / name).string();
  if (folder_.empty()) return std::string(name);
  const fs::path shipped = fs::path(folder_) / name;
  std::error_code error;
  if (user_folder_.empty() || fs::exists(shipped, error)) return shipped.string();
  const fs::path added = fs::path(user_folder_) / name;
  return fs::exists(added, error) ? added.string() : shipped.string();
}

std::string ModelStore::path(std::string_view name) const {
  if (folder_.empty() && !is_own(name)) {
    throw ModelError(std::string(name), "no folder of models was found: set TARSIER_MODELS to it");
  }
  if (!has(name)) {
    throw ModelError(expected_path(name),
                     "is missing from the folder of models: put it there, set TARSIER_MODELS to a "
                     "folder that has it, or name a file of your own");
  }
  return expected_path(name);
}

std::string ModelStore::path_or(const std::string& given, std::string_view name) const {
  return given.empty() ? path(name) : given;
}

}  // namespace tarsier
