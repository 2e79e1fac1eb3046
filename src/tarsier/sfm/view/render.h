// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/sfm/scene/model.h"

#include <opencv2/core.hpp>

#include <functional>

// Renders images of a reconstruction without a display. The result is deterministic, byte by byte.
namespace tarsier::sfm {

struct ViewOptions {
  cv::Size size{960, 720};              // px, each side
  double yaw_deg = 0;                   // to the right around the cloud; 0: the side of the cameras
  double pitch_deg = 15;                // above the horizon
  double distance = 0;                  // world units from the cloud's centre; 0: the cloud fits
  int point_px = 0;                     // size at the cloud's centre; 0: large enough to close gaps
  bool cameras = true;                  // draw the registered cameras
  cv::Vec3b background{250, 248, 246};  // BGR

  [[nodiscard]] OptionFields fields() {
    return {{"size.width", size.width, range(16, 16384)},
            {"size.height", size.height, range(16, 16384)},
            {"pitch_deg", pitch_deg, range(-89, 89)},
            {"distance", distance, at_least(0)},
            {"point_px", point_px, range(0, 64)}};
  }
  void check() const;  // throws std::invalid_argument
};

// The pinhole camera of render_model().
struct Viewpoint {
  geometry::Camera camera;
  geometry::Rigid3 pose;  // camera_from_world
  double distance = 0;    // world units, to the centre of the cloud
};
[[nodiscard]] Viewpoint viewpoint_of(const Model& model, const ViewOptions& options);

// Renders the points in their colours, nearer ones in front of farther ones and distant ones paler.
// Cameras are pyramids, faint where points hide them. CV_8UC3. A model without points and cameras
// gives the plain background.
[[nodiscard]] cv::Mat render_model(const Model& model, const ViewOptions& options);

// A full turn in `frames` (>= 1) images, starting at options.yaw_deg. `take` receives the index of
// the frame, from 0, and an image that is reused after it returns.
void render_turntable(const Model& model, const ViewOptions& options, int frames,
                      const std::function<void(int, const cv::Mat&)>& take);

}  // namespace tarsier::sfm
