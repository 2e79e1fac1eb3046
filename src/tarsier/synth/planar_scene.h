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

// Flat prints on a ground plane, seen by a known camera, with exact ground truth.
//
// The world: metres; the ground is the plane z = 0, seen from z > 0. A print's own frame: origin at
// the centre of its part (below), x right, y up, z out of the sheet towards the viewer.
namespace tarsier::synth {

struct PlanarPrint {
  int id = 0;  // in the truth; negative: a cover, which hides others and has no truth
  std::string name;
  cv::Mat image;  // CV_8UC1, BGR or BGRA (not premultiplied); at most 8192 px a side
  // px of the image, edges at integers: the region to which the truth refers (a marker without its
  // white margin); empty: the whole image.
  cv::Rect2d part;
  double width = 0;  // m, of the part, > 0; its pixels are square
  void check() const;
};

// The scene at one moment.
struct PlanarShot {
  geometry::Rigid3 camera_from_world;
  std::vector<geometry::Rigid3> world_from_print;  // one for each print
};

// Properties of the exposure. A pixel's value is gain * light * reflectance + haze.
struct ImagingConditions {
  double gain = 1;           // exposure, 0..4
  double slope = 0;          // relative difference of light between the image's sides, 0..1
  double slope_angle = 0;    // radians, in the image: direction of the bright side
  double vignette = 0;       // relative loss of light at the corners, 0..1
  double shadow = 0;         // relative loss of light on one side of a line, 0..1
  double shadow_angle = 0;   // radians, of the line's normal
  double shadow_offset = 0;  // px, distance of the line from the image's centre
  double shadow_width = 10;  // px, width of its soft edge, > 0
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
  // Corners of the part, px, as printed: top left first, clockwise. They may lie outside the image.
  std::array<cv::Point2d, 4> corners;
  double side_px = 0;  // mean of its four sides
  double width = 0;    // m
  double visible = 0;  // share of the part that is inside the image and not hidden, 0..1
  double facing = 0;   // cosine of the angle between the print's normal and the line of sight
};

// The prints and ground of a scene, seen by one camera. Const after construction; copies share the
// images. Everything is filtered with the pixel's footprint on the print: between 1 and 64 samples
// of a pyramid whose pixels are no larger than half the footprint. Nothing therefore aliases at a
// distance, and edges lie exactly where the truth states.
class PlanarScene {
 public:
  // `ground` (CV_8UC3) is repeated with mirroring over the plane z = 0. It is `ground_width` m
  // wide, with its centre at the origin. Throws std::invalid_argument.
  PlanarScene(const geometry::Camera& camera, std::vector<PlanarPrint> prints,
              const cv::Mat& ground, double ground_width);

  [[nodiscard]] const geometry::Camera& camera() const;
  [[nodiscard]] const std::vector<PlanarPrint>& prints() const;

  // The mean of the images at `shots`: one shot for objects at rest, several (in order of time) for
  // motion blur. Does not depend on the number of threads. Throws std::invalid_argument for no
  // shots, or poses that do not match the prints.
  [[nodiscard]] cv::Mat render(std::span<const PlanarShot> shots,
                               const ImagingConditions& imaging) const;

  // Of the prints in front of the camera that show their front, in their order, without covers.
  [[nodiscard]] std::vector<PrintTruth> truth(const PlanarShot& shot) const;

  struct Parts;

 private:
  std::shared_ptr<const Parts> parts_;
};

}  // namespace tarsier::synth
