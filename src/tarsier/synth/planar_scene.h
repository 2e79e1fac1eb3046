// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"

#include <opencv2/core.hpp>

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

// Flat prints before a ground, as a known camera sees them, with exact truth.
//
// The world: metres; the ground is the plane z = 0, seen from z > 0. A print's own frame: origin at
// the middle of its part (below), x right, y up, z out of the sheet towards the viewer.
namespace tarsier::synth {

struct PlanarPrint {
  int id = 0;  // in the truth; negative: a cover, which hides others and has no truth
  std::string name;
  cv::Mat image;     // CV_8UC1, BGR or BGRA (not premultiplied); at most 8192 px a side
  cv::Rect2d part;   // px of the image, edges at integers: what the truth is about (a marker
                     // without its white margin); empty: all of it
  double width = 0;  // m, of the part, > 0; its pixels are square
  void check() const;
};

// What is in front of the camera at one moment.
struct PlanarShot {
  geometry::Rigid3 camera_from_world;
  std::vector<geometry::Rigid3> world_from_print;  // one for each print
};

// How the image is taken. A pixel's value is gain * light * reflectance + haze.
struct PlanarLook {
  double gain = 1;           // exposure, 0..4
  double slope = 0;          // share by which light differs between the image's sides, 0..1
  double slope_angle = 0;    // radians, in the image: towards the bright side
  double vignette = 0;       // share of light that the corners lack, 0..1
  double shadow = 0;         // share of light that a shadow takes on one side of a line, 0..1
  double shadow_angle = 0;   // radians, of the line's normal
  double shadow_offset = 0;  // px, of the line from the image's middle
  double shadow_width = 10;  // px, of its soft edge, > 0
  double haze = 0;           // grey levels, 0..255
  double defocus_px = 0.5;   // standard deviation, 0..20
  double noise = 2;          // grey levels, 0..64
  bool color = true;         // CV_8UC3, else CV_8UC1
  std::uint64_t seed = 1;    // of the noise
  void check() const;        // throws std::invalid_argument
};

struct PrintTruth {
  int id = 0;
  std::string name;
  geometry::Rigid3 camera_from_print;
  // px of the part's corners, as printed: top left, then clockwise. Outside the image too.
  std::array<cv::Point2d, 4> corners;
  double side_px = 0;  // mean of its four sides
  double width = 0;    // m
  double visible = 0;  // share of the part inside the image and not hidden, 0..1
  double facing = 0;   // cosine of the angle between the print's normal and the line of sight
};

// A scene's prints and ground seen by one camera. Const after construction; copies share the
// images. All that is drawn is filtered by the pixel's own footprint on the print: between 1 and
// 64 samples of a pyramid whose pixels are no larger than half the footprint, so that nothing
// aliases from afar and edges lie where the truth says.
class PlanarScene {
 public:
  // `ground` (CV_8UC3) repeats, mirrored, over the plane z = 0, `ground_width` m wide, its middle
  // in the origin. Throws std::invalid_argument.
  PlanarScene(const geometry::Camera& camera, std::vector<PlanarPrint> prints,
              const cv::Mat& ground, double ground_width);

  [[nodiscard]] const geometry::Camera& camera() const;
  [[nodiscard]] const std::vector<PlanarPrint>& prints() const;

  // The mean of the images at `shots`: one of a object at rest, several (in order of time) for
  // motion blur. Does not depend on the number of threads. Throws std::invalid_argument for no
  // shots, or poses that do not fit the prints.
  [[nodiscard]] cv::Mat render(std::span<const PlanarShot> shots, const PlanarLook& look) const;

  // Of the prints before the camera that show their front, in their order, covers left out.
  [[nodiscard]] std::vector<PrintTruth> truth(const PlanarShot& shot) const;

  struct Parts;

 private:
  std::shared_ptr<const Parts> parts_;
};

}  // namespace tarsier::synth
