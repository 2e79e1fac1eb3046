// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/pipelines/calibrator.h"

#include "framework/cli.h"
#include "framework/run_session.h"
#include <string>

namespace tarsier::cli {

struct CalibrateFlags {
  RunFlags run;  // its output is "none": -o names the camera file
  std::string board;
  std::string square;
  std::string output;
  std::string lens = "pinhole";
  std::string format = "tarsier";
  std::string csv;
  std::string undistorted;
  std::string draw;
  bool no_tangential = false;
  planar::calibration::CalibrateOptions lens_options;
  int max_views = 40;  // for a video or a camera
};

// Prints one JSON line per image.
void print_images(const planar::CalibrationResult& result);
// Writes the requested files and reports the result as JSON lines or a table. Throws InputError if
// no camera was found.
[[nodiscard]] ExitStatus finish_calibration(const CalibrateFlags& flags,
                                            const planar::CalibrationResult& result,
                                            Context& context);

}  // namespace tarsier::cli
