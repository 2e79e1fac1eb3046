// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/inputs.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/still_source.h"
#include "tarsier/sfm/pipelines/colmap_database.h"
#include "tarsier/sfm/scene/colmap.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <iterator>
#include <optional>
#include <set>
#include <system_error>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxDepth = 32;  // max depth of nested folders
constexpr const char* kResultFiles[] = {"report.json", "plan.json", "cameras.txt",
                                        "cameras.bin", "sparse",    "stereo"};

// `name` is relative, with or without folders. A repeated name becomes e.g. cam0/a-2.jpg.
void add_input(const std::string& name, const std::string& path, std::set<std::string>& names,
               std::vector<Input>& inputs) {
  const fs::path file(name);
  std::string unique_name = name;
  for (int k = 2; !names.insert(unique_name).second; ++k) {
    unique_name = (file.parent_path() /
                   fmt::format("{}-{}{}", file.stem().string(), k, file.extension().string()))
                      .string();
  }
  inputs.push_back({unique_name, path});
}

void add_inputs(const std::vector<std::string>& paths, std::set<std::string>& names,
                std::vector<Input>& inputs) {
  for (const std::string& path : paths)
    add_input(fs::path(path).filename().string(), path, names, inputs);
}

// Whether the folder holds results of a program: a model, a dense workspace, the work of shards.
bool has_results(const fs::path& folder) {
  std::error_code ignored;
  return std::any_of(std::begin(kResultFiles), std::end(kResultFiles),
                     [&](const char* name) { return fs::exists(folder / name, ignored); });
}

// Adds the names of images in a folder and its subfolders, relative to it, with `prefix` in front.
void add_names(const fs::path& folder, const std::string& prefix, const fs::path& output, int depth,
               std::vector<std::string>& names) {
  std::error_code error;
  fs::directory_iterator entries(folder, error);
  if (error) {
    if (depth > 0)
      log_warning("{}: cannot be read: {} (left out)", folder.string(), error.message());
    return;
  }
  std::error_code ignored;
  for (; entries != fs::directory_iterator(); entries.increment(error)) {
    if (error) throw InputError(folder.string(), "cannot be read: " + error.message());
    const std::string name = entries->path().filename().string();
    if (name.starts_with(".")) continue;
    if (entries->is_regular_file(ignored)) {
      if (has_image_extension(name)) names.push_back(prefix + name);
    } else if (entries->is_directory(ignored) && !entries->is_symlink(ignored) &&
               depth < kMaxDepth && !has_results(entries->path()) &&
               (output.empty() || !fs::equivalent(entries->path(), output, ignored))) {
      add_names(entries->path(), prefix + name + "/", output, depth + 1, names);
    }
  }
}

void add_folder(const std::string& folder, const std::string& output, std::set<std::string>& names,
                std::vector<Input>& inputs) {
  std::vector<std::string> found;
  add_names(folder, "", output, 0, found);
  if (found.empty()) (void)images_in_folder(folder);  // throws with the reason
  std::sort(found.begin(), found.end(), natural_less);
  for (const std::string& name : found)
    add_input(name, (folder.ends_with("/") ? folder : folder + "/") + name, names, inputs);
  const auto deep = std::count_if(found.begin(), found.end(), [](const std::string& name) {
    return name.find('/') != std::string::npos;
  });
  if (deep > 0) log_info("{}: {} of {} images are in subfolders", folder, deep, found.size());
}

std::vector<std::string> frames_of_video(const std::string& video, const KeyframeOptions& keyframes,
                                         const std::string& folder, Progress& progress,
                                         const std::stop_token& stop) {
  if (folder.empty()) throw InputError(video, "a video needs an output folder for its key frames");
  make_folder(folder);
  const auto source = open_source(video, SourceOptions{});
  KeyframePicker picker(keyframes);
  std::vector<std::string> paths;
  const auto keep = [&](const std::optional<Keyframe>& frame) {
    if (!frame) return;
    paths.push_back(key_frame_path(folder, *frame));
    write_image(paths.back(), frame->image);
  };
  progress.begin("key frames", source->count(), "frames");
  while (auto frame = source->next(std::chrono::milliseconds(1000), stop)) {
    throw_if_stopped(stop);
    if (picker.count() >= keyframes.max_count) {
      log_warning("{}: the frames from {} on are not used: the limit of {} key frames is reached",
                  video, frame->index, keyframes.max_count);
      break;
    }
    keep(picker.offer(frame->image, frame->index, frame->time));
    progress.advance();
  }
  throw_if_stopped(stop);
  keep(picker.finish());
  progress.end();
  log_info("{}: {} key frames", video, paths.size());
  return paths;
}

}  // namespace

std::vector<Input> find_inputs(const std::vector<std::string>& sources,
                               const KeyframeOptions& keyframes, const std::string& frames_folder,
                               Progress& progress, const std::stop_token& stop) {
  std::vector<Input> inputs;
  std::set<std::string> names;
  for (const std::string& text : sources) {
    switch (classify_source(text)) {
      case SourceKind::kFolder:
        add_folder(text, fs::path(frames_folder).parent_path().string(), names, inputs);
        break;
      case SourceKind::kGlob:
        add_inputs(files_of_glob(text), names, inputs);
        break;
      case SourceKind::kList:
        add_inputs(paths_of_list(text.substr(1)), names, inputs);
        break;
      case SourceKind::kImage:
        add_inputs({text}, names, inputs);
        break;
      case SourceKind::kVideo:
        add_inputs(frames_of_video(text, keyframes, frames_folder, progress, stop), names, inputs);
        break;
      default:
        throw InputError(text, "expected images, a folder, @list.txt or a video");
    }
  }
  return inputs;
}

std::string key_frame_path(const std::string& folder, const Keyframe& frame) {
  return (fs::path(folder) / fmt::format("frame-{:06}.png", frame.index)).string();
}

std::vector<Input> inputs_of_database(const std::string& path) {
  std::vector<Input> inputs;
  for (const ColmapDatabase::DatabaseImage& image : read_colmap_database(path).images)
    inputs.push_back({image.name, ""});
  return inputs;
}

void require_names(const std::vector<Input>& inputs) {
  for (const Input& input : inputs) {
    if (const std::string error = image_name_error(input.name); !error.empty())
      throw InputError(printable(input.path), error + ": rename it");
  }
}

void require_two_images(const std::vector<Input>& inputs, const std::string& source) {
  if (inputs.size() >= 2) return;
  throw InputError(source, fmt::format("{} image{}; a reconstruction needs two or more",
                                       inputs.size(), inputs.size() == 1 ? "" : "s"));
}

}  // namespace tarsier::sfm
