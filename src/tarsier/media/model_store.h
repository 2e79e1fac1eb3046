// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>

namespace tarsier {

// The folder of trained models, and the files in it by name. Pipelines take from it what they need:
//
//   const ModelStore models = ModelStore::find();
//   const plate::Reader reader = plate::Reader::load(models);
//   const std::string path = models.path("head.json");  // or file by file
//
// Const; may be shared by threads. Nothing is kept open.
class ModelStore {
 public:
  // Without a folder: has() is false for every name, path() throws.
  ModelStore() = default;
  // Throws InputError where `folder` is not a folder.
  explicit ModelStore(std::string folder);

  // In this order: `folder`, the environment variable TARSIER_MODELS, the folder that comes with
  // the program that runs (../../../models from it in a build tree, share/tarsier/models where it
  // is installed in bin or libexec/tarsier); a store without a folder where there is none of these. A program that links
  // the installed library gets the folder as `tarsier_MODELS_DIR` from find_package(tarsier). What
  // the folder that comes with the program lacks is looked for in user_models_folder()
  // (user_models.h).
  // Throws InputError where `folder` or TARSIER_MODELS is not a folder.
  [[nodiscard]] static ModelStore find(const std::string& folder = {});

  // Empty where there is none.
  [[nodiscard]] const std::string& folder() const { return folder_; }
  // Whether there is a file or folder `name`, e.g. "head.json".
  [[nodiscard]] bool has(std::string_view name) const;
  // Where `name` would be; a bare `name` where there is no folder. For messages.
  [[nodiscard]] std::string place_of(std::string_view name) const;
  // Path of `name`. Throws ModelError, which says what to do, where it is missing.
  [[nodiscard]] std::string path(std::string_view name) const;
  // `given`, the path of a user's own model, or where that is empty path(name).
  [[nodiscard]] std::string path_or(const std::string& given, std::string_view name) const;

 private:
  std::string folder_;
};

// The folder of the program that runs; empty where it is not known.
[[nodiscard]] std::string program_folder();

}  // namespace tarsier
