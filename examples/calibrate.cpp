// SPDX-License-Identifier: MIT
// calibrate BOARD SQUARE INPUT: calibrates a camera from images or a video of a board with squares
// of SQUARE metres; prints one JSON line.
//   calibrate chess:9x6 0.025 board.mp4
#include "tarsier/core/errors.h"
#include "tarsier/planar/pipelines/calibrator.h"
#include "tarsier/synth/sources.h"

#include <cstdio>
#include <exception>
#include <nlohmann/json.hpp>
#include <string>

int main(int argc, char** argv) try {
  if (argc != 4) {
    std::fprintf(stderr, "usage: calibrate BOARD SQUARE INPUT\n");
    return 2;
  }
  tarsier::planar::CalibratorOptions options;
  options.board = tarsier::planar::calibration::parse_board(argv[1], std::stod(argv[2]));
  const auto calibrator = tarsier::planar::Calibrator::load(options);
  tarsier::planar::CalibratorState state;
  tarsier::NoProgress progress;
  const auto source = tarsier::open_source(argv[3], {}, {tarsier::synth::synth_scheme()});
  calibrator.search(*source, state, progress);
  const tarsier::planar::CalibrationResult result = calibrator.calibrate(state);
  std::printf("%s\n", to_json(result).dump().c_str());
  return result.ok() ? 0 : 3;
} catch (const std::exception& error) {
  std::fprintf(stderr, "calibrate: %s\n", error.what());
  return 1;
}
