// SPDX-License-Identifier: MIT
// face_pose INPUT: the direction of each head, in degrees, and its distance.
//   face_pose portrait.jpg
//   face_pose 0            (a camera)
#include "tarsier/core/errors.h"
#include "tarsier/face/pipelines/pose_tracker.h"
#include "tarsier/media/frame_source.h"

#include <opencv2/core/matx.hpp>

#include <chrono>
#include <cstdio>
#include <exception>

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: face_pose INPUT\n");
    return 2;
  }
  try {
    const auto tracker = tarsier::face::PoseTracker::load(tarsier::ModelStore::find());
    const auto source = tarsier::open_source(argv[1]);
    tarsier::face::PoseState state;
    while (!source->ended()) {
      const auto frame = source->next(std::chrono::seconds(1), {});
      if (!frame) continue;
      for (const auto& [face, pose, reason] : tracker.process(*frame, state).faces) {
        if (!pose) continue;
        std::printf("face %d: yaw %.1f, pitch %.1f, roll %.1f, %.0f mm away\n", face.id,
                    pose->angles.yaw_deg, pose->angles.pitch_deg, pose->angles.roll_deg,
                    pose->camera_from_head.translation.norm());
      }
    }
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "face_pose: %s\n", error.what());
    return 1;
  }
}
