// SPDX-License-Identifier: MIT
// sfm_online FOLDER INPUT: a model that grows with a video or camera; one JSON line per frame.
//   sfm_online frames 0       (a camera; Ctrl-C ends)
//   sfm_online frames drawn   (a synthetic walk along a wall)
#include "tarsier/core/stop.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/sfm/pipelines/online_reconstructor.h"
#include "tarsier/synth/sfm_scene.h"

#include <chrono>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>

using namespace tarsier;

int main(int argc, char** argv) try {
  if (argc != 3) return std::fprintf(stderr, "usage: sfm_online FOLDER INPUT\n"), 2;
  const std::stop_token stop = stop_on_signals();
  sfm::OnlineReconstructorOptions options;
  options.frames_folder = argv[1];
  sfm::OnlineReconstructor online(options);
  const auto print = [](const sfm::OnlineResult& result) {
    std::printf("%s\n", to_json(result).dump().c_str());
  };
  if (argv[2] == std::string("drawn")) {
    const synth::SfmScene wall({.size = {320, 240}, .trajectory = synth::Trajectory::kLine});
    for (Frame frame; frame.index < wall.count(); ++frame.index) {
      frame.image = wall.render(static_cast<int>(frame.index));
      print(online.process(frame, stop));
    }
  } else {
    for (const auto source = open_source(argv[2]); !source->ended() && !stop.stop_requested();)
      if (const auto frame = source->next(std::chrono::seconds(1), stop))
        print(online.process(*frame, stop));
  }
  print(online.finish());
} catch (const std::exception& error) {
  return std::fprintf(stderr, "sfm_online: %s\n", error.what()), 1;
}
