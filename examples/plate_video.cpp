// SPDX-License-Identifier: MIT
// plate_video INPUT: tracks the vehicles of a video or camera; prints one JSON line when a vehicle
// has left.
//   plate_video street.mp4
//   plate_video 'synth:drive?seconds=8&cars=2&parked=0&far=0&fps=8&size=640x360&seed=6'
#include "tarsier/core/errors.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/plate/reader/video_reader.h"
#include "tarsier/synth/sources.h"

#include <chrono>
#include <cstdio>
#include <exception>
#include <nlohmann/json.hpp>

using tarsier::plate::PlateEvent, tarsier::plate::VideoReader;

void print_closed(const std::vector<PlateEvent>& events) {
  for (const PlateEvent& event : events)
    if (event.state == tarsier::plate::PlateState::kClosed)
      std::printf("%s\n", event_json(event).dump().c_str());
}

int main(int argc, char** argv) try {
  if (argc != 2) {
    std::fprintf(stderr, "usage: plate_video INPUT\n");
    return 2;
  }
  const auto reader = VideoReader::load(tarsier::ModelStore::find());
  const auto source = tarsier::open_source(argv[1], {}, {tarsier::synth::synth_scheme()});
  tarsier::plate::VideoReaderState state;
  while (!source->ended())
    if (const auto frame = source->next(std::chrono::seconds(1), {}))
      print_closed(reader.process(*frame, state).events);
  print_closed(reader.finish(state));
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "plate_video: %s\n", error.what());
  return 1;
}
