// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/results.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/words.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/scene/colmap.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string_view>
#include <system_error>
#include <vector>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr std::int64_t kMaxReportBytes = 1'000'000'000;
constexpr int kMaxModels = 1'000'000;
// The key of "images" in reports of older versions.
constexpr const char* kOldImagesKey = "photographs";
constexpr const char* kReportWriter = "tarsier sfm reconstruct";
constexpr const char* kModelFiles[] = {"cameras.txt", "images.txt",   "points3D.txt", "cameras.bin",
                                       "images.bin",  "points3D.bin", "points.ply",   "cameras.ply",
                                       "view.png",    "view.html",    "turntable.gif"};

Json read_report(const fs::path& folder) {
  try {
    const std::string path = (folder / "report.json").string();
    return parse_json(read_file(path, kMaxReportBytes), path,
                      {.max_bytes = kMaxReportBytes, .max_values = kMaxReportBytes});
  } catch (const InputError&) {
    return nullptr;
  }
}

int integer_or_zero(const Json& object, const char* name) {
  const auto found = object.find(name);
  return found != object.end() && found->is_number_integer()
             ? static_cast<int>(std::clamp<std::int64_t>(found->get<std::int64_t>(), 0, kMaxModels))
             : 0;
}

bool is_report_of_model(const fs::path& folder, int model) {
  const Json report = read_report(folder);
  return report.is_object() && report.value("written_by", Json()) == kReportWriter &&
         integer_or_zero(report, "model") == model;
}

void remove_file(const fs::path& path) {
  std::error_code error;
  if (fs::is_regular_file(fs::symlink_status(path, error))) fs::remove(path, error);
}

// Removes empty folders, the innermost first.
void remove_folders(const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> folders;
  for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    if (!entry->is_symlink(error) && entry->is_directory(error)) folders.push_back(entry->path());
  }
  std::reverse(folders.begin(), folders.end());
  for (const fs::path& path : folders) fs::remove(path, error);  // fails where it is not empty
  fs::remove(folder, error);
}

// Removes the undistorted images of the model in that folder.
void remove_undistorted(const fs::path& folder) {
  try {
    for (const Image& image : read_colmap_poses((folder / "sparse").string()).images)
      remove_file(folder / "images" / image.name);
  } catch (const Error&) {
    return;
  }
  for (const char* name : {"cameras.txt", "images.txt", "points3D.txt"})
    remove_file(folder / "sparse" / name);
}

}  // namespace

std::optional<EarlierRun> earlier_run(const std::string& folder) {
  const Json report = read_report(folder);
  if (!report.is_object()) return std::nullopt;
  const auto has_list = [&](const char* name) {
    return report.contains(name) && report[name].is_array();
  };
  // Older versions wrote "story" for "log", and kOldImagesKey for "images".
  if (!has_list("models") || !(has_list("images") || has_list(kOldImagesKey)) ||
      !has_list("stages") || !(has_list("log") || has_list("story"))) {
    return std::nullopt;
  }
  EarlierRun run;
  run.models = static_cast<int>(std::min<std::size_t>(report["models"].size(), kMaxModels));
  if (run.models > 0 && report["models"][0].is_object())
    run.registered = integer_or_zero(
        report["models"][0], report["models"][0].contains("images") ? "images" : kOldImagesKey);
  run.partial = report.value("partial", Json()) == true;
  return run;
}

std::map<std::string, std::string> image_files(const std::string& folder, const std::string& images,
                                               const std::vector<std::string>& names,
                                               bool is_report_trusted) {
  std::vector<fs::path> folders{images};
  std::map<std::string, std::string> reported;
  if (images.empty()) {
    folders = {fs::path(folder) / "images", fs::path(folder) / "frames"};
    const Json report = is_report_trusted ? read_report(folder) : Json();
    Json list;
    if (report.is_object())
      list = report.value(report.contains("images") ? "images" : kOldImagesKey, Json());
    for (const Json& image : list.is_array() ? list : Json::array()) {
      if (!image.is_object()) continue;
      const Json name = image.value("name", Json());
      const Json file = image.value("file", Json());
      if (name.is_string() && file.is_string())
        reported[name.get<std::string>()] = file.get<std::string>();
    }
  }
  std::map<std::string, std::string> files;
  std::error_code error;
  for (const std::string& name : names) {
    for (const fs::path& directory : folders) {
      if (files.count(name) == 0 && fs::is_regular_file(directory / name, error))
        files[name] = (directory / name).string();
    }
    const auto found = reported.find(name);
    if (files.count(name) == 0 && found != reported.end() &&
        fs::is_regular_file(found->second, error))
      files[name] = found->second;
    if (files.count(name) == 0) {
      throw InputError(printable(images.empty() ? folder : images),
                       fmt::format("the image '{}' of the model was not found: give the folder of "
                                   "the images (option 'images')",
                                   printable(name)));
    }
  }
  return files;
}

std::string model_folder(const std::string& folder, int model) {
  return model == 0 ? folder : (fs::path(folder) / fmt::format("model-{}", model)).string();
}

void begin_model_folder(const std::string& folder, int model) {
  TARSIER_REQUIRE(model >= 1, "model {}", model);
  const std::string path = model_folder(folder, model);
  make_folder(path);
  const nlohmann::ordered_json report{{"written_by", kReportWriter}, {"model", model}};
  write_file_atomically((fs::path(path) / "report.json").string(), report.dump(1) + "\n");
}

void remove_replaced_files(const std::string& folder) {
  const fs::path path(folder);
  std::error_code error;
  if (!fs::exists(path / "report.json", error)) return;
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin", "rigs.bin", "frames.bin",
                           "rigs.txt", "frames.txt"}) {
    remove_file(path / name);
    if (fs::exists(path / name, error))
      throw OutputError((path / name).string(),
                        "the file belongs to an earlier model and cannot be removed: remove it");
  }
}

int remove_old_models(const std::string& folder, int first,
                      const std::optional<EarlierRun>& earlier) {
  int removed = 0;
  std::error_code error;
  std::vector<fs::path> entries;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error))
    entries.push_back(entry.path());
  for (const fs::path& path : entries) {
    const std::string name = path.filename().string();
    constexpr std::string_view kPrefix = "model-";
    if (!name.starts_with(kPrefix)) continue;
    const std::string_view digits = std::string_view(name).substr(kPrefix.size());
    const auto number = to_integer(digits, 1, kMaxModels);
    if (!number || digits != std::to_string(*number)) continue;
    const int model = static_cast<int>(*number);
    if (model < first || fs::is_symlink(fs::symlink_status(path, error)) ||
        !fs::is_directory(path, error)) {
      continue;
    }
    const bool is_own = is_report_of_model(path, model);
    if (!is_own && !(earlier && model < earlier->models)) continue;
    remove_undistorted(path / "undistorted");
    for (const char* file : kModelFiles) remove_file(path / file);
    if (is_own) remove_file(path / "report.json");
    remove_folders(path);
    ++removed;
    if (fs::exists(path, error))
      log_warning(
          "{}: the earlier model was removed, except for files that the earlier run did not write",
          path.string());
  }
  return removed;
}

}  // namespace tarsier::sfm
