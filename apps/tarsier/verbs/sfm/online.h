// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame_source.h"
#include "tarsier/sfm/mapper/pipeline.h"
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
  std::string view;     // video, folder or address that the views go to; "": nowhere
  std::string actions;  // "-": actions by name on stdin
  int every = 3;        // key frames from one growth to the next
  std::int64_t frames = 0;
  SourceOptions source;
};

void add_online_flags(Command& verb, OnlineFlags& flags);

struct OnlineRun {
  std::vector<sfm::Input> inputs;  // the key frames
  ExitStatus status = ExitStatus::kDone;
  std::exception_ptr error;  // that of a source that was lost, or that broke off
};

// As classify_source(), with the scenes that the program draws.
[[nodiscard]] SourceKind kind_of_online_source(const std::string& text);

// Shows `sources`: `images`, of which each is a key frame, or, without images, a video or camera,
// whose key frames are written to the folder of `reconstructor`. Throws the library's errors, but
// not what ends a source that gave frames.
[[nodiscard]] OnlineRun run_online(const std::vector<std::string>& sources,
                                   const std::vector<sfm::Input>& images,
                                   const sfm::Reconstructor& reconstructor,
                                   const OnlineFlags& flags, Context& context);

}  // namespace tarsier::cli
