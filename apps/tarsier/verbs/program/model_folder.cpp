// SPDX-License-Identifier: MIT
#include "verbs/program/model_folder.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <filesystem>
#include <sstream>
#include <system_error>
#include <utility>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;

std::string checksum_line_error(int number) {
  return fmt::format("line {} is not '<64 hexadecimal digits>  <file name>' (made by sha256sum)",
                     number);
}

// The models of one folder, by file name.
std::map<std::string, ModelFile> models_in(const std::string& folder) {
  std::map<std::string, ModelFile> files;
  for (const auto& [file, sum] : read_model_index(folder)) {
    if (fs::path(file).extension() == ".md") continue;
    files[file].expected = sum;
  }
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    const std::string file = entry.path().filename().string();
    if (file.front() == '.' || file == kModelIndex || entry.path().extension() == ".md") continue;
    if (!entry.is_regular_file(error)) continue;
    ModelFile& model = files[file];
    model.exists = true;
    model.bytes = static_cast<std::int64_t>(entry.file_size(error));
  }
  if (error) throw ModelError(folder, error.message());
  for (auto& [file, model] : files) {
    model.name = fs::path(file).stem().string();
    model.file = file;
    model.path = (fs::path(folder) / file).string();
  }
  return files;
}

}  // namespace

std::map<std::string, std::string> read_model_index(const std::string& folder) {
  const fs::path path = fs::path(folder) / kModelIndex;
  std::map<std::string, std::string> sums;
  std::error_code error;
  if (!fs::exists(path, error)) return sums;
  std::istringstream text(read_file(path.string(), 1'000'000));
  int number = 0;
  for (std::string line; std::getline(text, line);) {
    ++number;
    if (line.empty() || line.front() == '#') continue;
    const bool is_sum = line.size() > 66 && line.find_first_not_of("0123456789abcdef") == 64 &&
                        line[64] == ' ' && (line[65] == ' ' || line[65] == '*');
    const std::string name = is_sum ? line.substr(66) : "";
    // A name must be a file directly in this folder: an index must not lead elsewhere.
    if (name.empty() || name.front() == '.' || name.find('/') != std::string::npos) {
      throw ModelError(path.string(), checksum_line_error(number));
    }
    sums[name] = line.substr(0, 64);
  }
  return sums;
}

std::vector<ModelFile> find_models(const ModelStore& store) {
  std::map<std::string, ModelFile> files;
  if (!store.folder().empty()) files = models_in(store.folder());
  std::error_code error;
  if (!store.own_folder().empty() && fs::is_directory(store.own_folder(), error)) {
    for (auto& [file, model] : models_in(store.own_folder())) {
      if (!model.exists) continue;  // the shipped model is used
      model.is_own = true;
      files[file] = std::move(model);
    }
  }
  if (!store.user_folder().empty() && fs::is_directory(store.user_folder(), error)) {
    for (auto& [file, model] : models_in(store.user_folder())) {
      if (!model.exists || files.contains(file)) continue;
      model.is_added = true;
      files[file] = std::move(model);
    }
  }
  std::vector<ModelFile> models;
  for (auto& [file, model] : files) {
    const fs::path card = fs::path(store.folder()) / (model.name + ".md");
    if (!store.folder().empty() && fs::exists(card, error)) model.card = card.string();
    models.push_back(std::move(model));
  }
  return models;
}

std::string problem_of(const ModelFile& model, std::optional<Archive>& archive) {
  if (!model.exists) return "is in the index but missing";
  try {
    archive = read_any_archive(model.path);
  } catch (const Error& error) {
    const std::string what = error.what();
    const std::string prefix = model.path + ": ";
    return what.starts_with(prefix) ? what.substr(prefix.size()) : what;
  }
  return {};
}

std::string card_text(const ModelFile& model, const std::string& key) {
  if (model.card.empty()) return {};
  std::istringstream card(read_file(model.card, 1'000'000));
  const std::string start = "| " + key + " | ";
  for (std::string line; std::getline(card, line);) {
    if (!line.starts_with(start) || !line.ends_with(" |")) continue;
    std::string text = line.substr(start.size(), line.size() - start.size() - 2);
    std::erase(text, '`');
    return text;
  }
  return {};
}

}  // namespace tarsier::cli
