// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/planar/markers/dictionary.h"
#include "tarsier/synth/planar_scene.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

// Complete scenes of prints: still images by seed, and videos.
namespace tarsier::synth {

enum class PlanarLevel { kEasy, kMedium, kHard };  // difficulty of light, blur and noise
[[nodiscard]] std::string_view name_of(PlanarLevel level);

// One image with its truth.
struct PlanarStill {
  cv::Mat image;
  geometry::Camera camera;
  PlanarLevel level = PlanarLevel::kEasy;
  ImagingConditions imaging;
  double motion_px = 0;  // blur of a moving camera
  double motion_angle = 0;
  std::vector<PrintTruth> truth;  // only prints that are entirely inside the image
};

struct StillOptions {
  cv::Size size{640, 480};  // px
  int min_prints = 1;       // minimum number of prints
  int max_prints = 8;
  double min_side_px = 12;   // of a print's part, before it is tilted
  double max_side_px = 300;  // limited to 0.6 of the image's smaller side
  double tilt_deg = 60;      // maximum
  double hidden_share = 0;   // share of prints that a hand or a bar partly hides

  [[nodiscard]] OptionFields fields() {
    return {{"size.width", size.width, range(64, 8192)},
            {"size.height", size.height, range(64, 8192)},
            {"least", min_prints, range(0, 16), "--min-markers",
             "minimum of the random number of markers in an image"},
            {"most", max_prints, range(0, 16), "--max-markers",
             "maximum of the random number of markers in an image"},
            {"min_side_px", min_side_px, range(4, 8192), "--min-side",
             "px, minimum frontal side of a marker, or of a target [80]"},
            {"max_side_px", max_side_px, range(4, 8192), "--max-side",
             "px, maximum frontal side; at most 0.6 of the image height"},
            {"tilt_deg", tilt_deg, range(0, 80), "--tilt", "degrees, maximum tilt"},
            {"part_hidden", hidden_share, range(0, 1), "--hidden",
             "share of markers partly occluded by a hand or a bar"}};
  }
  void check() const;
};

// Markers at random poses in front of clutter. Everything is derived from `seed`. `side`: m.
[[nodiscard]] PlanarStill marker_still(const planar::markers::Dictionary& family, double side,
                                       const StillOptions& options, PlanarLevel level,
                                       std::uint64_t seed);
// One of `prints`, alone in the image, with its own id.
[[nodiscard]] PlanarStill print_still(const std::vector<PlanarPrint>& prints,
                                      const StillOptions& options, PlanarLevel level,
                                      std::uint64_t seed);

struct VideoOptions {
  cv::Size size{640, 480};  // px
  double fps = 25;
  double speed_px = 25;       // maximum motion of a print's corner between two frames
  double tilt_deg = 50;       // of the camera, maximum
  double shutter = 0.25;      // exposed share of a frame's time
  double exposure = 0.2;      // relative amplitude of the exposure's variation
  bool with_occluder = true;  // a hand sometimes passes over the prints
  bool distorted = false;     // a lens with k1 = -0.25
  // Its gain is multiplied by the variation; its seed is that of the first frame's noise.
  ImagingConditions imaging;
  std::uint64_t seed = 1;  // of ground and path

  [[nodiscard]] OptionFields fields() {
    return {{"size.width", size.width, range(64, 8192)},
            {"size.height", size.height, range(64, 8192)},
            {"fps", fps, above(0, 1000)},
            {"speed_px", speed_px, range(0, 100)},
            {"tilt_deg", tilt_deg, range(0, 75)},
            {"shutter", shutter, range(0, 1)},
            {"exposure", exposure, range(0, 0.8)}};
  }
  void check() const;
};

// A camera that moves above a desk with prints and rests after each round of 6 s (4.5 s of motion).
// Const; a frame depends only on the time.
class PlanarVideo {
 public:
  // `world_from_print`: poses of the prints; `radius` (m): of the part of the desk that stays in
  // view.
  PlanarVideo(std::vector<PlanarPrint> prints, std::vector<geometry::Rigid3> world_from_print,
              double radius, const VideoOptions& options);

  [[nodiscard]] const geometry::Camera& camera() const { return scene_.camera(); }
  [[nodiscard]] const std::vector<PlanarPrint>& prints() const { return scene_.prints(); }
  [[nodiscard]] PlanarShot shot_at(double time_s) const;
  [[nodiscard]] cv::Mat image_at(double time_s) const;
  [[nodiscard]] std::vector<PrintTruth> truth_at(double time_s) const;
  // Whether the camera rests.
  [[nodiscard]] static bool is_at_rest(double time_s);

 private:
  [[nodiscard]] geometry::Rigid3 camera_at(double path) const;
  // The maximum motion of a corner in the image.
  [[nodiscard]] double motion_px(const PlanarShot& from, const PlanarShot& to) const;
  void set_rate();

  VideoOptions options_;
  double radius_;
  std::vector<geometry::Rigid3> world_from_print_;
  PlanarScene scene_;
  double rate_ = 1;  // ratio of the path's time to the video's time
};

// `count` (1..12) markers 0.. of a family on a desk, each `side` m wide; one of them lies on a
// slope.
[[nodiscard]] PlanarVideo marker_video(const planar::markers::Dictionary& family, int count,
                                       double side, const VideoOptions& options);
// Prints side by side, flat on the desk.
[[nodiscard]] PlanarVideo print_video(std::vector<PlanarPrint> prints, const VideoOptions& options);

// One line of truth: {"image", "family" or "target", "K", "dist", "size", "level", "params",
// "markers": [{"id", "corners", "rvec", "tvec", "side_px", "visible", and with `targets` the
// homography "H" from the image's pixels}]}. `prints`: the prints of the still.
struct TruthLine {
  std::string image;
  std::string family;
  bool targets = false;
};
[[nodiscard]] std::string truth_line(const TruthLine& line, const PlanarStill& still,
                                     const std::vector<PlanarPrint>& prints);

// The list "markers" alone, for one moment of a video.
[[nodiscard]] std::string truth_list(const std::vector<PrintTruth>& truth);

using geometry::rotation_vector;

}  // namespace tarsier::synth
