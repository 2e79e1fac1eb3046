// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame_source.h"
#include "tarsier/sfm/pipelines/pipeline.h"
#include "tarsier/sfm/pipelines/reconstructor.h"

#include "framework/cli.h"
#include <cstdint>
#include <exception>
#include <string>
#include <vector>

namespace tarsier::cli {

// `sfm reconstruct --online`: the model grows while the frames arrive.
struct OnlineFlags {
  bool online = false;
  bool window = false;
  bool fullscreen = false;
  std::string view;     // where the views go: a video, folder or address; "": nowhere
  std::string actions;  // "-": reads actions by name from stdin
  int every = 3;        // key frames between two growth steps of the model
  std::int64_t frames = 0;
  SourceOptions source;
};

void add_online_flags(Command& verb, OnlineFlags& flags);

struct OnlineRun {
  std::vector<sfm::Input> inputs;  // the key frames
  ExitStatus status = ExitStatus::kDone;
  std::exception_ptr error;  // error of a source that was lost or that ended early
};

// As classify_source(), but also knows the synthetic scenes.
[[nodiscard]] SourceKind kind_of_online_source(const std::string& text);

// Processes and shows `sources`. With `images`, each image is a key frame. Without, the source is a
// video or camera whose key frames are written to the folder of `reconstructor`. Throws the
// library's errors, but not the error that ends a source after its first frame.
[[nodiscard]] OnlineRun run_online(const std::vector<std::string>& sources,
                                   const std::vector<sfm::Input>& images,
                                   const sfm::Reconstructor& reconstructor,
                                   const OnlineFlags& flags, Context& context);

}  // namespace tarsier::cli
