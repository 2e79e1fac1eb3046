// SPDX-License-Identifier: MIT
// cartoon OUTPUT INPUT [MODE]: filters images, a video or a camera; prints one JSON line per frame.
//   cartoon drawn.png photo.jpg sketch
//   cartoon drawn.mp4 walk.mp4
#include "tarsier/cartoon/cartoonizer.h"
#include "tarsier/media/frame_sink.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/synth/sources.h"

#include <chrono>
#include <cstdio>
#include <exception>
#include <nlohmann/json.hpp>

using namespace tarsier;

int main(int argc, char** argv) try {
  if (argc < 3) return std::fprintf(stderr, "usage: cartoon OUTPUT INPUT [MODE]\n"), 2;
  cartoon::CartoonOptions options;
  if (argc > 3) options.mode = cartoon::parse_mode(argv[3]);
  const auto cartoonizer = cartoon::Cartoonizer::load(ModelStore::find(), options);
  const auto source = open_source(argv[2], {}, {synth::synth_scheme()});
  const auto sink = open_sink(argv[1]);
  cartoon::CartoonizerState state;
  while (!source->ended()) {
    const auto frame = source->next(std::chrono::seconds(1), {});
    if (!frame) continue;
    const auto result = cartoonizer.process(*frame, state);
    (void)sink->write(result.image, *frame);
    std::printf("%s\n", to_json(result).dump().c_str());
  }
  sink->finish();
} catch (const std::exception& error) {
  return std::fprintf(stderr, "cartoon: %s\n", error.what()), 1;
}
