// SPDX-License-Identifier: MIT
// plate_read INPUT [COUNTRY..]: reads the number plates of images; prints one JSON line per image.
//   plate_read car.jpg es pt
//   plate_read 'synth:car?frames=3&seed=11'
#include "tarsier/core/errors.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/plate/reader/reader.h"
#include "tarsier/synth/sources.h"

#include <chrono>
#include <cstdio>
#include <exception>
#include <nlohmann/json.hpp>

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: plate_read INPUT [COUNTRY..]\n");
    return 2;
  }
  try {
    tarsier::plate::ReaderOptions options;
    options.countries.assign(argv + 2, argv + argc);
    const auto reader = tarsier::plate::Reader::load(tarsier::ModelStore::find(), options);
    const auto source = tarsier::open_source(argv[1], {}, {tarsier::synth::synth_scheme()});
    while (!source->ended()) {
      const auto frame = source->next(std::chrono::seconds(1), {});
      if (!frame) continue;
      nlohmann::ordered_json line{{"image", frame->name}};
      line.update(to_json(reader.process(*frame)));
      std::printf("%s\n", line.dump().c_str());
    }
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "plate_read: %s\n", error.what());
    return 1;
  }
}
