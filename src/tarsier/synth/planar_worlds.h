// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/rotation.h"
#include "tarsier/planar/markers/dictionary.h"
#include "tarsier/synth/planar_scene.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

// Ready scenes of prints: still pictures by seed, and videos.
namespace tarsier::synth {

enum class PlanarLevel { kEasy, kMedium, kHard };  // of light, blur and noise
[[nodiscard]] std::string_view name_of(PlanarLevel level);

// One picture with its truth.
struct PlanarStill {
  cv::Mat picture;
  geometry::Camera camera;
  PlanarLevel level = PlanarLevel::kEasy;
  PlanarLook look;
  double motion_px = 0;  // blur of the moving camera
  double motion_angle = 0;
  std::vector<PrintTruth> truth;  // only prints that are wholly inside the picture
};

struct StillOptions {
  cv::Size size{640, 480};  // px, 64..8192
  int least = 1;            // prints, 0..16
  int most = 8;
  double min_side_px = 12;   // of a print's part, before it is tilted
  double max_side_px = 300;  // at most 0.6 of the picture's smaller side
  double tilt_deg = 60;      // at most, 0..80
  double part_hidden = 0;    // share of prints that a hand or a bar hides in part, 0..1
  void check() const;
};

// Each print where it likes, in front of clutter. Everything follows from `seed`. `side`: m.
[[nodiscard]] PlanarStill marker_still(const planar::markers::Dictionary& family, double side,
                                       const StillOptions& options, PlanarLevel level,
                                       std::uint64_t seed);
// One of `prints` (each used as it is, its id is known), alone in the picture.
[[nodiscard]] PlanarStill print_still(const std::vector<PlanarPrint>& prints,
                                      const StillOptions& options, PlanarLevel level,
                                      std::uint64_t seed);

struct VideoOptions {
  cv::Size size{640, 480};  // px, 64..8192
  double fps = 25;          // > 0
  double speed_px = 25;     // fastest motion of a print's corner between two frames, 0..100
  double tilt_deg = 50;     // of the camera, at most, 0..75
  double shutter = 0.25;    // share of a frame's time that is exposed, 0..1
  double exposure = 0.2;    // by which share the exposure swings, 0..0.8
  bool cover = true;        // a hand passes over the prints now and then
  bool distorted = false;   // a lens with k1 = -0.25
  PlanarLook look;          // its gain times the swing; the seed is of the first frame's noise
  std::uint64_t seed = 1;   // of ground and path
  void check() const;
};

// A camera that moves about a desk with prints and comes to rest for a while after each round of
// 6 s (4.5 s of motion). Const; a frame depends on the time alone.
class PlanarVideo {
 public:
  // `world_from_print`: where they lie; `radius` (m): of the part of the desk that stays in view.
  PlanarVideo(std::vector<PlanarPrint> prints, std::vector<geometry::Rigid> world_from_print,
              double radius, const VideoOptions& options);

  [[nodiscard]] const geometry::Camera& camera() const { return scene_.camera(); }
  [[nodiscard]] const std::vector<PlanarPrint>& prints() const { return scene_.prints(); }
  [[nodiscard]] PlanarShot shot_at(double time_s) const;
  [[nodiscard]] cv::Mat picture_at(double time_s) const;
  [[nodiscard]] std::vector<PrintTruth> truth_at(double time_s) const;
  // Whether the camera rests.
  [[nodiscard]] static bool is_at_rest(double time_s);

 private:
  [[nodiscard]] geometry::Rigid camera_at(double path) const;
  // The largest distance that a corner moves in the picture.
  [[nodiscard]] double motion_px(const PlanarShot& from, const PlanarShot& to) const;
  void set_rate();

  VideoOptions options_;
  double radius_;
  std::vector<geometry::Rigid> world_from_print_;
  PlanarScene scene_;
  double rate_ = 1;  // of the path's time to the video's
};

// `count` (1..12) markers 0.. of a family on a desk, each `side` m wide, one of them on a slope.
[[nodiscard]] PlanarVideo marker_video(const planar::markers::Dictionary& family, int count,
                                       double side, const VideoOptions& options);
// Prints side by side, flat on the desk.
[[nodiscard]] PlanarVideo print_video(std::vector<PlanarPrint> prints, const VideoOptions& options);

// One line of truth: {"image", "family" or "target", "K", "dist", "size", "level", "params",
// "markers": [{"id", "corners", "rvec", "tvec", "side_px", "visible", and with `targets` the
// homography "H" from the picture's pixels}]}. `prints`: of which `truth` tells.
struct TruthLine {
  std::string image;
  std::string family;
  bool targets = false;
};
[[nodiscard]] std::string truth_line(const TruthLine& line, const PlanarStill& still,
                                     const std::vector<PlanarPrint>& prints);

// The list "markers" alone, of a video's moment.
[[nodiscard]] std::string truth_list(const std::vector<PrintTruth>& truth);

using geometry::rotation_vector;

}  // namespace tarsier::synth
