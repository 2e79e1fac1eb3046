// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera_file.h"
#include "tarsier/media/frame.h"
#include "tarsier/planar/calibration/calibrate.h"
#include "tarsier/planar/calibration/collector.h"

#include "cli.h"
#include "run_session.h"
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tarsier::cli {

struct CalibrateFlags {
  RunFlags run;  // its output is "none": -o is the camera
  std::string board;
  std::string square;
  std::string output;
  std::string lens = "pinhole";
  std::string format = "tarsier";
  std::string csv;
  std::string undistorted;
  std::string draw;
  int views = 40;  // of a video or a camera
  bool no_tangential = false;
  planar::calibration::CalibrateOptions options;
};

// One picture that was looked at.
struct CalibrationPicture {
  std::string name;  // of a still
  std::int64_t index = 0;
  double time = 0;
  bool still = true;
  bool found = false;
  std::string reason;    // why it is not among the views
  std::size_t view = 0;  // where it is
  double ms = 0;
  cv::Mat image;  // of videos, where --draw or --undistorted want it
};

struct CalibrationJob {
  planar::calibration::BoardSpec spec;
  cv::Size size;
  std::vector<CalibrationPicture> pictures;
  std::vector<planar::calibration::BoardView> views;
};

// Calibrates, writes what the flags ask for, and reports: JSON lines, or a table for people. Throws
// InputError where the views fix no camera.
[[nodiscard]] ExitStatus finish_calibration(const CalibrateFlags& flags, const CalibrationJob& job,
                                            Context& context);

}  // namespace tarsier::cli
