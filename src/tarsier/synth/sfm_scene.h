// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <stop_token>
#include <vector>

// Rendered scenes with known cameras and exact depth, to test structure from motion.
//
// The world: a surface near z = 0 seen from z > 0, x right and y up for a frontal viewer. Its unit
// is arbitrary; cameras are 10 units away, in streets 7 or more. For a ring, streets and a grid, z
// is up and the surface is the ground. A grid requires the content relief, boxes or plane, and has
// houses everywhere on the first two.
namespace tarsier::synth {

enum class Trajectory {
  kArc,   // up to 60 degrees around the centre, 7 degrees apart (closer from 10 images on)
  kRing,  // all around, 42 degrees above the ground
  kLine,  // steps of 0.9 units to the right (shorter from 15 images on), looking straight ahead
  kGrid,  // from above, straight down, in rows 2 units apart, 2.4 units from image to image
  kWalk,  // along a winding street, 1.8 units per image, looking ahead and to the left; no loop
  kCity,  // through all streets of square blocks, looking ahead and to the left; many loops
};

enum class Content {
  kRelief,    // an uneven wall, 2 units deep, and a dozen boxes that stand out of it
  kBoxes,     // a dozen boxes on a plane
  kPlane,     // a flat wall
  kRepeated,  // the uneven wall, with one tile of 1.6 units everywhere
  kNothing,   // a flat wall of one colour
  kRoom,      // a niche: a wall, two side walls, a floor, and boxes on the wall
  kThin,      // fins a few hundredths of a unit thick on a plane
  kPatchy,    // the uneven wall, a third of it covered by squares of one colour
  kShiny,     // the uneven wall with highlights that move with the camera
  // A box of 3 x 3 x 2.4 units on white; its four sides are alike except for some details.
  kSymmetric,
  kHouses,  // houses along streets, with identical windows; only for kWalk and kCity
  // A temple on white with 16 identical columns; symmetric under half a turn except for details.
  kTemple,
  kToy,  // a figure on white whose front and back are alike except for details
};

struct SceneOptions {
  std::uint64_t seed = 1;   // of surface, texture, cameras and noise
  cv::Size size{640, 480};  // px, of each image
  double focal_px = 0;      // 0: the larger side; else 0.5..20 times the larger side
  int images = 8;
  Trajectory trajectory = Trajectory::kArc;
  Content content = Content::kRelief;
  double noise = 2;  // grey levels, standard deviation
  // All images from one place, rotated in steps of 7 degrees; ignores trajectory.
  bool pure_rotation = false;
  double details = 0.2;  // unique share of a face's area, 0..0.5; for symmetric objects
  double repeats = 0;    // share of the houses that look like others, 0..1; for kHouses

  [[nodiscard]] OptionFields fields() {
    return {{"size.width", size.width, range(32, 8192)},
            {"size.height", size.height, range(32, 8192)},
            {"images", images, range(1, 100'000), "--images", "number of images to render"},
            {"noise", noise, range(0, 64), "--noise",
             "grey levels, standard deviation of the image noise"},
            {"pure_rotation", pure_rotation, "--pure-rotation",
             "rotate the camera without translation"}};
  }
  void check() const;  // throws std::invalid_argument, which names the bad value
};

// A surface of triangles, counter-clockwise as seen from outside, in the world's units.
struct SceneSurface {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<std::array<int, 3>> triangles;
};

// Const after construction; copies share their data. The same options give the same scene. Another
// size or focal length gives the same scene seen by another camera. Scenes of different seeds have
// different textures.
class SfmScene {
 public:
  explicit SfmScene(const SceneOptions& options);  // throws std::invalid_argument

  [[nodiscard]] int count() const;                // number of images
  [[nodiscard]] geometry::Camera camera() const;  // of all images, without distortion

  // The members below throw std::invalid_argument unless 0 <= index < count().
  [[nodiscard]] geometry::Rigid3 pose(int index) const;  // camera from world
  // CV_8UC3 of the size of the options. Does not depend on the number of threads. Throws
  // Interrupted.
  [[nodiscard]] cv::Mat render(int index, const std::stop_token& stop = {}) const;
  // Depth (z in the camera) of the surface at `pixel`, from the exact surface, to 1e-8 units; also
  // outside the image. Empty if there is nothing within 100 units.
  [[nodiscard]] std::optional<double> depth(int index, cv::Point2d pixel) const;
  // The exact surface as triangles between points at most `step` units apart (0.005..1). It covers
  // what lies in the view of a camera, hidden or not, but not the ground below solids or parts of
  // solids below the ground. Patches of ground and faces share no vertices. Throws
  // std::invalid_argument, Interrupted.
  [[nodiscard]] SceneSurface surface(double step, const std::stop_token& stop = {}) const;

  struct Parts;

 private:
  std::shared_ptr<const Parts> parts_;
};

// Simulated observations of points, without images.
struct PointProblem {
  struct Observation {
    int image = 0;
    int point = 0;
    cv::Point2d pixel;
    bool outlier = false;  // random pixel, more than 10 px from the truth
  };
  geometry::Camera camera;                // 640 x 480, without distortion
  std::vector<geometry::Rigid3> poses;    // camera from world
  std::vector<Eigen::Vector3d> points;    // world
  std::vector<Observation> observations;  // by image, then by point
};

// Cameras on an arc as in Trajectory::kArc, points uniform in a volume of 6 x 4 x 3 units, and the
// observations of each point in all images. Observations have normal noise of `noise_px` (0..100)
// px; with probability `outlier_share` (0..1) one is an outlier. Throws std::invalid_argument for
// other values and unless images is 1..1000 and points 1..1000000.
[[nodiscard]] PointProblem make_point_problem(std::uint64_t seed, int images, int points,
                                              double noise_px, double outlier_share);

}  // namespace tarsier::synth
