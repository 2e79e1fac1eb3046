// SPDX-License-Identifier: MIT
// face_appearance INPUT: how well an active appearance model explains each face, and the position
// of its nose.
//   face_appearance portrait.jpg
//   face_appearance 0            (a camera)
#include "tarsier/core/errors.h"
#include "tarsier/face/pipelines/appearance_tracker.h"
#include "tarsier/media/frame_source.h"

#include <chrono>
#include <cstdio>
#include <exception>

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: face_appearance INPUT\n");
    return 2;
  }
  try {
    const auto tracker = tarsier::face::AppearanceTracker::load(tarsier::ModelStore::find());
    const auto source = tarsier::open_source(argv[1]);
    tarsier::face::AppearanceState state;
    while (!source->ended()) {
      const auto frame = source->next(std::chrono::seconds(1), {});
      if (!frame) continue;
      for (const auto& [id, fit] : tracker.process(*frame, state))
        std::printf("face %d: %.0f %% explained, nose at %.0f %.0f\n", id, 100 * (1 - fit.error),
                    fit.points(0, 30), fit.points(1, 30));
    }
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "face_appearance: %s\n", error.what());
    return 1;
  }
}
