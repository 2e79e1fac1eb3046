// SPDX-License-Identifier: MIT
// target_track IMAGE INPUT: trains a flat image as a target, then detects it in other images, or
// tracks it in a video or camera; prints one JSON line per frame.
//   target_track cover.jpg desk.mp4
#include "tarsier/core/errors.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/image_file.h"
#include "tarsier/planar/image_targets/train.h"
#include "tarsier/planar/pipelines/target_tracker.h"

#include <chrono>
#include <cstdio>
#include <exception>
#include <nlohmann/json.hpp>

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: target_track IMAGE INPUT\n");
    return 2;
  }
  try {
    // write_target() stores it, TargetTracker::load() reads such files.
    const tarsier::planar::TargetTracker tracker(
        {tarsier::planar::image_targets::train_target(tarsier::read_image(argv[1]), "target")});
    const auto source = tarsier::open_source(argv[2]);
    tarsier::planar::TargetState state;
    while (!source->ended()) {
      const auto frame = source->next(std::chrono::seconds(1), {});
      if (!frame) continue;
      nlohmann::ordered_json line{{"image", frame->name}};
      line.update(to_json(tracker.process(*frame, state)));
      std::printf("%s\n", line.dump().c_str());
    }
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "target_track: %s\n", error.what());
    return 1;
  }
}
