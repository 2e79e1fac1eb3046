// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>

namespace tarsier {

// The folder of trained models, with access to its files by name. Pipelines load their models from
// it:
//
//   const ModelStore models = ModelStore::find();
//   const plate::Reader reader = plate::Reader::load(models);
//   const std::string path = models.path("head.json");  // or single files
//
// A second folder may hold the user's own models (`tarsier models install`). A file there replaces
// the shipped file of the same name.
//
// Immutable; threads may share it. No file is kept open.
class ModelStore {
 public:
  // A store without a folder: has() is false for every name, path() throws.
  ModelStore() = default;
  // Throws InputError where `folder` is not a folder.
  explicit ModelStore(std::string folder);

  // Chooses the folder in this order: `folder`; the environment variable TARSIER_MODELS; the folder
  // that comes with the running program (../../../models from it in a build tree,
  // share/tarsier/models if it is installed in bin or libexec/tarsier); else a store without a
  // folder. A program that links the installed library gets the folder as `tarsier_MODELS_DIR` from
  // find_package(tarsier).
  // Without `folder`, the environment variable TARSIER_OWN_MODELS names the folder of the user's
  // own models; it need not exist. Files that are missing in the program's folder are searched in
  // user_models_folder() (user_models.h). Throws InputError if `folder` or TARSIER_MODELS is not a
  // folder.
  [[nodiscard]] static ModelStore find(const std::string& folder = {});

  // Empty if there is none.
  [[nodiscard]] const std::string& folder() const { return folder_; }
  [[nodiscard]] const std::string& own_folder() const { return own_folder_; }
  // The folder for files that are missing in the program's own folder; empty where another folder
  // was chosen.
  [[nodiscard]] const std::string& user_folder() const { return user_folder_; }
  // Whether path(name) is one of the user's own models.
  [[nodiscard]] bool is_own(std::string_view name) const;
  // The same store without the user's own models.
  [[nodiscard]] ModelStore shipped() const;
  // Whether a file or folder `name` exists, e.g. "head.json".
  [[nodiscard]] bool has(std::string_view name) const;
  // The expected path of `name`; only `name` if there is no folder. For messages.
  [[nodiscard]] std::string expected_path(std::string_view name) const;
  // Path of `name`. Throws ModelError if it is missing; the message says what to do.
  [[nodiscard]] std::string path(std::string_view name) const;
  // Returns `given`, the path of a user's model, or path(name) if `given` is empty.
  [[nodiscard]] std::string path_or(const std::string& given, std::string_view name) const;

 private:
  [[nodiscard]] static ModelStore find_shipped();

  std::string folder_;
  std::string own_folder_;
  std::string user_folder_;
};

// The folder of the running program; empty if unknown.
[[nodiscard]] std::string program_folder();

}  // namespace tarsier
