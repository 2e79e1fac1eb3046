// SPDX-License-Identifier: MIT
// markers INPUT [SIDE [FAMILY..]]: the poses of printed markers with sides of SIDE metres [0.05],
// of the families [36h11]; prints one line per marker.
//   markers desk.jpg 0.08 aruco-original
//   markers 0            (a camera)
#include "tarsier/core/errors.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/planar/pipelines/marker_tracker.h"
#include "tarsier/synth/sources.h"

#include <chrono>
#include <cstdio>
#include <exception>
#include <string>

int main(int argc, char** argv) try {
  if (argc < 2) {
    std::fprintf(stderr, "usage: markers INPUT [SIDE [FAMILY..]]\n");
    return 2;
  }
  tarsier::planar::MarkerTrackerOptions options;
  if (argc > 2) options.side = std::stod(argv[2]);
  if (argc > 3) options.families.assign(argv + 3, argv + argc);
  const auto tracker = tarsier::planar::MarkerTracker::load(options);
  const auto source = tarsier::open_source(argv[1], {}, {tarsier::synth::synth_scheme()});
  tarsier::planar::MarkerState state;
  while (!source->ended()) {
    const auto frame = source->next(std::chrono::seconds(1), {});
    if (!frame) continue;
    for (const auto& [family, marker, pose] : tracker.process(*frame, state).markers)
      if (pose)
        std::printf("%.2f s: %s %d, %.3f m away\n", frame->time, family.c_str(), marker.id,
                    pose->camera_from_marker.translation.norm());
  }
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "markers: %s\n", error.what());
  return 1;
}
