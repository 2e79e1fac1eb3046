// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/inputs.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/still_source.h"
#include "tarsier/sfm/mapper/colmap_database.h"
#include "tarsier/sfm/scene/colmap.h"

#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <optional>
#include <set>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;

void add_inputs(const std::vector<std::string>& paths, std::set<std::string>& names,
                std::vector<Input>& inputs) {
  for (const std::string& path : paths) {
    const fs::path file(path);
    std::string name = file.filename().string();
    for (int k = 2; !names.insert(name).second; ++k)
      name = fmt::format("{}-{}{}", file.stem().string(), k, file.extension().string());
    inputs.push_back({name, path});
  }
}

std::vector<std::string> frames_of_video(const std::string& video, const KeyframeOptions& keyframes,
                                         const std::string& folder, Progress& progress,
                                         const std::stop_token& stop) {
  if (folder.empty())
    throw InputError(video, "a video needs a folder that its key frames are written to");
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
        add_inputs(images_in_folder(text), names, inputs);
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
    if (const std::string trouble = trouble_of_name(input.name); !trouble.empty())
      throw InputError(printable(input.path), trouble + ": rename it");
  }
}

void require_two_images(const std::vector<Input>& inputs, const std::string& source) {
  if (inputs.size() >= 2) return;
  throw InputError(source, fmt::format("{} image{}; a reconstruction needs two or more",
                                       inputs.size(), inputs.size() == 1 ? "" : "s"));
}

}  // namespace tarsier::sfm
