// SPDX-License-Identifier: MIT
// face_landmarks INPUT: the 68 landmarks of each face, one JSON line per frame; in a video each
// face keeps its id.
//   face_landmarks portrait.jpg
//   face_landmarks 0            (a camera)
#include "tarsier/core/errors.h"
#include "tarsier/face/pipelines/landmark_tracker.h"
#include "tarsier/media/frame_source.h"

#include <chrono>
#include <cstdio>
#include <exception>
#include <nlohmann/json.hpp>

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: face_landmarks INPUT\n");
    return 2;
  }
  try {
    const auto tracker = tarsier::face::LandmarkTracker::load(tarsier::ModelStore::find());
    const auto source = tarsier::open_source(argv[1]);
    tarsier::face::LandmarkState state;
    while (!source->ended()) {
      const auto frame = source->next(std::chrono::seconds(1), {});
      if (!frame) continue;
      nlohmann::ordered_json line{{"image", frame->name}};
      line.update(to_json(tracker.process(*frame, state)));
      std::printf("%s\n", line.dump().c_str());
    }
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "face_landmarks: %s\n", error.what());
    return 1;
  }
}
