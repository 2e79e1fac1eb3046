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

// The sums of a folder's models, as `sha256sum` writes them.
inline constexpr const char* kModelIndex = "SHA256SUMS";

// One model file, or a line of the index without its file.
struct ModelFile {
  std::string name;  // of the file, without its ending
  std::string file;  // with it
  std::string path;
  std::int64_t bytes = 0;
  std::string expected;  // its sum in the index of its folder; empty: not there
  std::string card;      // path of NAME.md, of the one that ships; empty: none
  bool exists = false;
  bool is_own = false;    // the user's own, in place of one that ships
  bool is_added = false;  // from the user's folder of models, beside those that ship: in no index
};

// File name -> sum. Nothing where there is no such file. Throws ModelError for lines of another
// form, and for names that are no file of this very folder.
[[nodiscard]] std::map<std::string, std::string> read_model_index(const std::string& folder);

// All models, by name: those of the user's own in place of those that ship. Throws ModelError.
[[nodiscard]] std::vector<ModelFile> find_models(const ModelStore& store);

// What is wrong with a model, or an empty string. `archive` takes what was read.
[[nodiscard]] std::string problem_of(const ModelFile& model, std::optional<Archive>& archive);

// The text of the row "| KEY | TEXT |" of a model's card, without backquotes; empty: there is none.
[[nodiscard]] std::string card_text(const ModelFile& model, const std::string& key);

}  // namespace tarsier::cli
