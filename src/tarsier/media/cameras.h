// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

struct CameraMode {
  std::string format;  // V4L2 code of four characters: "MJPG", "YUYV"
  // px; the largest size, for a camera that takes any size.
  int width = 0;
  int height = 0;
  // Frame rates, highest first; empty if the driver does not report them.
  std::vector<double> fps;
};

// A V4L2 device that captures video.
struct CameraInfo {
  std::string path;  // "/dev/video0"
  // "/dev/v4l/by-id/..": these paths stay the same when device numbers change.
  std::vector<std::string> links;
  std::string card;               // name that the driver reports
  std::string driver;             // "uvcvideo"
  std::string bus;                // "usb-0000:00:14.0-1"
  std::vector<CameraMode> modes;  // at most 256
  std::string error;              // why it could not be queried (no permission); empty: no error
};

// All cameras, in the order of their numbers. Opens each device without starting it. Does not throw
// for a device that misbehaves.
[[nodiscard]] std::vector<CameraInfo> list_cameras();

// Why `path` cannot be used as a camera now ("no such device (/dev/video9); ..", no permission,
// does not capture), and what to do. Empty if it looks like a camera.
[[nodiscard]] std::string camera_error(const std::string& path);

// The path of an executable called `name` in one of the folders of $PATH; empty if there is none.
[[nodiscard]] std::string find_program_on_path(std::string_view name);

}  // namespace tarsier
