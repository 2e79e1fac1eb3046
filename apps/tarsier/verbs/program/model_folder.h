// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/archive.h"
#include "tarsier/media/model_store.h"

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::cli {

// The checksums of a folder's models, in the format of `sha256sum`.
inline constexpr const char* kModelIndex = "SHA256SUMS";

// One model file, or a line of the index whose file is missing.
struct ModelFile {
  std::string name;  // of the file, without its extension
  std::string file;  // with its extension
  std::string path;
  std::int64_t bytes = 0;
  std::string expected;  // checksum from the index of its folder; empty: not listed
  std::string card;      // path of NAME.md of the shipped model; empty: none
  bool exists = false;
  bool is_own = false;  // the user's own; it replaces a shipped model
  // From the user's folder of models, in addition to the shipped ones: in no index.
  bool is_added = false;
};

// Returns the map from file name to checksum; empty if the folder has no index. Throws ModelError
// for malformed lines and for names that are not files directly in this folder.
[[nodiscard]] std::map<std::string, std::string> read_model_index(const std::string& folder);

// All models, by name; the user's own replace shipped models. Throws ModelError.
[[nodiscard]] std::vector<ModelFile> find_models(const ModelStore& store);

// What is wrong with a model, or an empty string. `archive` receives the parsed file.
[[nodiscard]] std::string problem_of(const ModelFile& model, std::optional<Archive>& archive);

// The text of the row "| KEY | TEXT |" of a model's card, without backquotes; empty if there is
// none.
[[nodiscard]] std::string card_text(const ModelFile& model, const std::string& key);

}  // namespace tarsier::cli
