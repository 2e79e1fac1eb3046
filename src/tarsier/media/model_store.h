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
// A second folder may hold models of the user's own (`tarsier models install`): a file there is
// taken in place of the one of the same name that ships.
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
  // the installed library gets the folder as `tarsier_MODELS_DIR` from find_package(tarsier).
  // Without `folder`, the environment variable TARSIER_OWN_MODELS names the folder of the user's
  // own; one that is not there yet holds none. What the folder that comes with the program lacks is
  // looked for in user_models_folder() (user_models.h).
  // Throws InputError where `folder` or TARSIER_MODELS is not a folder.
  [[nodiscard]] static ModelStore find(const std::string& folder = {});

  // Empty where there is none.
  [[nodiscard]] const std::string& folder() const { return folder_; }
  [[nodiscard]] const std::string& own_folder() const { return own_folder_; }
  // The folder with what the program's own folder lacks; empty where another folder was named.
  [[nodiscard]] const std::string& user_folder() const { return user_folder_; }
  // Whether path(name) is the user's own.
  [[nodiscard]] bool is_own(std::string_view name) const;
  // The same store without models of the user's own.
  [[nodiscard]] ModelStore shipped() const;
  // Whether there is a file or folder `name`, e.g. "head.json".
  [[nodiscard]] bool has(std::string_view name) const;
  // Where `name` would be; a bare `name` where there is no folder. For messages.
  [[nodiscard]] std::string place_of(std::string_view name) const;
  // Path of `name`. Throws ModelError, which says what to do, where it is missing.
  [[nodiscard]] std::string path(std::string_view name) const;
  // `given`, the path of a user's own model, or where that is empty path(name).
  [[nodiscard]] std::string path_or(const std::string& given, std::string_view name) const;

 private:
  [[nodiscard]] static ModelStore find_shipped();

  std::string folder_;
  std::string own_folder_;
  std::string user_folder_;
};

// The folder of the program that runs; empty where it is not known.
[[nodiscard]] std::string program_folder();

}  // namespace tarsier
