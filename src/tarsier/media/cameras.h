// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

struct CameraMode {
  std::string format;  // four characters of V4L2: "MJPG", "YUYV"
  int width = 0;       // px; of a camera that takes any size: the largest
  int height = 0;
  std::vector<double> fps;  // frame rates, highest first; empty: the driver does not say
};

// A V4L2 device that captures video.
struct CameraInfo {
  std::string path;                // "/dev/video0"
  std::vector<std::string> links;  // "/dev/v4l/by-id/..", which stay when numbers move
  std::string card;                // its name, as the driver states it
  std::string driver;              // "uvcvideo"
  std::string bus;                 // "usb-0000:00:14.0-1"
  std::vector<CameraMode> modes;   // at most 256
  std::string trouble;             // not empty: why it could not be asked (no permission)
};

// All cameras, in the order of their numbers. Opens each device without starting it. Never throws
// for a device that misbehaves.
[[nodiscard]] std::vector<CameraInfo> list_cameras();

// Why `path` cannot be a camera now ("no such device (/dev/video9); ..", no permission, does not
// capture), with what to do; empty if it looks like one.
[[nodiscard]] std::string camera_trouble(const std::string& path);

// The path of an executable called `name` in one of the folders of $PATH; empty if there is none.
[[nodiscard]] std::string find_program_on_path(std::string_view name);

}  // namespace tarsier
