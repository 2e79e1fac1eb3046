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

// Scenes with known cameras and exact depth, drawn as images, to test structure from motion.
//
// The world: a surface near z = 0 seen from z > 0, x right and y up for who looks at it straight.
// Its unit is free; cameras stand 10 units off, in streets 7 or more. On a ring, in streets and below a
// grid, z is up and the surface is the ground. A grid needs the content relief, boxes or plane, and
// has houses all over the first two.
namespace tarsier::synth {

enum class Trajectory {
  kArc,   // up to 60 degrees around the middle, 7 degrees apart (closer from 10 images on)
  kRing,  // all around, 42 degrees above the ground
  kLine,  // steps of 0.9 units to the right (shorter from 15 images on), looking straight ahead
  kGrid,  // from above, straight down, in rows 2 units apart, 2.4 units from image to image
  kWalk,  // along a winding street of 1.8 units an image, looking ahead and to the left; no loop
  kCity,  // through all streets of square blocks, looking ahead and to the left; many loops
};

enum class Content {
  kRelief,     // a bumpy wall, 2 units deep, and a dozen boxes standing out of it
  kBoxes,      // a dozen boxes on a plane
  kPlane,      // a flat wall
  kRepeated,   // the bumpy wall, with one tile of 1.6 units all over
  kNothing,    // a flat wall of one colour
  kRoom,       // a niche: a wall, two side walls, a floor, and boxes on the wall
  kThin,       // fins of a few hundredths of a unit standing on a plane
  kPatchy,     // the bumpy wall, a third of it in squares of one colour
  kShiny,      // the bumpy wall with highlights that move with the camera
  kSymmetric,  // on white a box of 3 x 3 x 2.4 units whose four sides are alike but for some details
  kHouses,     // houses along streets, with windows that are alike; of kWalk and kCity alone
  kTemple,     // on white a temple of 16 columns alike, the same after half a turn but for details
  kToy,        // on white a figure whose front and back are alike but for details
};

struct SceneOptions {
  std::uint64_t seed = 1;   // of surface, texture, cameras and noise
  cv::Size size{640, 480};  // px, each
  double focal_px = 0;      // 0: the larger side; else 0.5..20 times the larger side
  int images = 8;
  Trajectory trajectory = Trajectory::kArc;
  Content content = Content::kRelief;
  double noise = 2;            // grey levels, standard deviation
  bool pure_rotation = false;  // all from one place, turned by steps of 7 degrees; no trajectory
  double details = 0.2;  // share of a face's area that no other has, 0..0.5; of symmetric objects
  double repeats = 0;    // share of the houses that look like others, 0..1; of kHouses

  [[nodiscard]] OptionFields fields() {
    return {{"size.width", size.width, range(32, 8192)},
            {"size.height", size.height, range(32, 8192)},
            {"images", images, range(1, 100'000), "--images", "images to render"},
            {"noise", noise, range(0, 64), "--noise", "grey levels"},
            {"pure_rotation", pure_rotation, "--pure-rotation", "the camera only turns"}};
  }
  void check() const;  // throws std::invalid_argument naming the bad value
};

// A surface of triangles, counter-clockwise as seen from outside, in the world's units.
struct SceneSurface {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<std::array<int, 3>> triangles;
};

// Const after construction; copies share what they hold. The same options give the same scene, and
// another size or focal length the same scene seen by another camera. Scenes of different seeds
// share no texture.
class ReliefScene {
 public:
  explicit ReliefScene(const SceneOptions& options);  // throws std::invalid_argument

  [[nodiscard]] int count() const;                // images
  [[nodiscard]] geometry::Camera camera() const;  // of all images, not distorted

  // The members below throw std::invalid_argument unless 0 <= index < count().
  [[nodiscard]] geometry::Rigid3 pose(int index) const;  // camera from world
  // CV_8UC3 of the size of the options. Does not depend on the number of threads. Throws
  // Interrupted.
  [[nodiscard]] cv::Mat render(int index, const std::stop_token& stop = {}) const;
  // z in the camera of what `pixel` sees, from the exact surface, to 1e-8 units; also outside the
  // image. Empty where nothing is within 100 units.
  [[nodiscard]] std::optional<double> depth(int index, cv::Point2d pixel) const;
  // The exact surface at points `step` units apart or less (0.005..1), in triangles: what lies in
  // the view of a camera, hidden or not, without the ground below solids and what of these is below
  // the ground; patches of ground and faces share no vertices. Throws
  // std::invalid_argument, Interrupted.
  [[nodiscard]] SceneSurface surface(double step, const std::stop_token& stop = {}) const;

  struct Parts;

 private:
  std::shared_ptr<const Parts> parts_;
};

// Points seen by cameras, without images.
struct PointProblem {
  struct Seen {
    int image = 0;
    int point = 0;
    cv::Point2d pixel;
    bool outlier = false;  // anywhere in the image, more than 10 px from the truth
  };
  geometry::Camera camera;              // 640 x 480, not distorted
  std::vector<geometry::Rigid3> poses;  // camera from world
  std::vector<Eigen::Vector3d> points;  // world
  std::vector<Seen> seen;               // by image, then by point
};

// Cameras on an arc as in Trajectory::kArc, points evenly in a volume of 6 x 4 x 3 units, and where
// each lies in every image that has it: with normal noise of `noise_px` (0..100) px, and with
// probability `outlier_share` (0..1) an outlier. Throws std::invalid_argument for these and unless
// images is 1..1000 and points 1..1000000.
[[nodiscard]] PointProblem make_point_problem(std::uint64_t seed, int images, int points,
                                              double noise_px, double outlier_share);

}  // namespace tarsier::synth
