// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core/types.hpp>

#include <array>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::cartoon {

enum class Mode { kNone, kSketch, kPaint, kCartoon, kEvil, kEvilSketch, kAlien, kSmooth };
// "none", "sketch", "paint", "cartoon", "evil", "evil-sketch", "alien", "smooth"
[[nodiscard]] std::string_view name_of(Mode mode);
[[nodiscard]] Mode parse_mode(std::string_view name);  // throws std::invalid_argument with the list
[[nodiscard]] const std::vector<Mode>& all_modes();

enum class Quality {
  kReference,  // the definition, by plain OpenCV calls
  kFast,       // the same image (identical masks, painting >= 45 dB), by vector kernels
  kDraft,      // fewer painting rounds, for slow machines
};
[[nodiscard]] std::string_view name_of(Quality quality);
[[nodiscard]] Quality parse_quality(std::string_view name);

// Pencil lines: grey, median, Laplacian (8-bit, so only its positive part), inverse threshold.
struct SketchOptions {
  int median_size = 7;     // px
  int laplacian_size = 5;  // aperture
  int threshold = 80;      // a pixel with a larger Laplacian response is a line
  // A black pixel whose 5x5 border is all white has its 3x3 centre whitened.
  bool remove_pepper = true;

  [[nodiscard]] OptionFields fields() {
    return {
        {"sketch.threshold", threshold, range(0, 255), "--sketch-threshold",
         "threshold of the Laplacian; higher: fewer lines"},
        {"sketch.median_size", median_size, odd_range(3, 7), "--sketch-median",
         "px, size of the median filter"},
        {"sketch.laplacian_size", laplacian_size, odd_range(1, 7), "--sketch-laplacian",
         "aperture of the Laplacian"},
        {"sketch.remove_pepper", remove_pepper, "--pepper,!--no-pepper", "remove isolated dots"}};
  }
};

// Oil painting: bilateral filters on the half-size image.
struct PaintOptions {
  int rounds = 7;          // each with two bilateral filters
  int diameter = 9;        // px
  double sigma_color = 9;  // grey levels
  double sigma_space = 7;  // px

  [[nodiscard]] OptionFields fields() {
    return {{"paint.rounds", rounds, range(0, 50), "--paint-rounds",
             "number of rounds of two bilateral filters each"},
            {"paint.diameter", diameter, odd_range(3, 15), "--paint-diameter",
             "px, diameter of the bilateral filter"},
            {"paint.sigma_color", sigma_color, above(0, 255), "--paint-sigma-color",
             "grey levels, sigma of the bilateral filter in colour"},
            {"paint.sigma_space", sigma_space, above(0, 100), "--paint-sigma-space",
             "px, sigma of the bilateral filter in space"}};
  }
};

// Thick dark lines: 3x3 Scharr, sum of +x and -x (and +y, -y), inverse threshold, median.
struct EvilOptions {
  bool both_axes = false;  // --evil-axes xy
  int threshold = 12;
  int median_size = 3;  // px; 1 disables it

  [[nodiscard]] OptionFields fields() {
    return {{"evil.threshold", threshold, range(0, 255), "--evil-threshold",
             "threshold of the Scharr gradient"},
            {"evil.median_size", median_size, odd_range(1, 7), "--evil-median",
             "px, size of the median filter; 1: none"}};
  }
};

enum class SkinStyle {
  kGlow,  // `color` is added to the skin
  kTint,  // the skin keeps its brightness and gets the hue and saturation of `color`
};
enum class FaceMode {
  kOutline,  // the user places the face in the outline; six seeds in the centre of the image
  kAuto,     // faces are detected, and the skin colour of each is learned
};

// Skin: flood fill from six points of the face outline, bounded by edges, in Y'CrCb.
struct SkinOptions {
  FaceMode face = FaceMode::kOutline;
  SkinStyle style = SkinStyle::kGlow;
  cv::Scalar color{0, 70, 0};            // BGR, each 0..255
  int edge_threshold = 80;               // of the half-size Laplacian response
  std::array<int, 3> lower{60, 25, 20};  // Y', Cr, Cb: tolerance below the seed, 0..255
  std::array<int, 3> upper{80, 15, 15};  // tolerance above the seed
  double learned_distance = 2.6;         // kAuto: maximum Mahalanobis distance of skin in CrCb
  // kAuto: the cascade file of the face detector; empty: OpenCV's, see face::find_cascade().
  std::string cascade;

  [[nodiscard]] OptionFields fields() {
    return {{"skin.edge_threshold", edge_threshold, range(0, 255), "--skin-edge-threshold",
             "threshold of the Laplacian at half size"},
            {"skin.learned_distance", learned_distance, above(0, 10), "--skin-distance",
             "auto: maximum Mahalanobis distance of a skin colour"}};
  }
};

// Whether the mode segments the skin.
[[nodiscard]] bool uses_skin(Mode mode);

// Reduces flickering lines in video. See stabilize.h.
struct SteadyOptions {
  bool on = false;
  // Hysteresis: share of the threshold on both sides of it within which a line keeps its state.
  double hysteresis = 0.3;
  int motion = 10;  // a pixel has moved if its median grey level changes by more
  int memory = 6;   // number of frames over which a still pixel is averaged

  [[nodiscard]] OptionFields fields() {
    return {
        {"steady.hysteresis", hysteresis, range(0, 0.9), "--steady-hysteresis",
         "half-width of the hysteresis, share of the threshold"},
        {"steady.motion", motion, range(1, 255), "--steady-motion",
         "grey levels, minimum change that counts as motion"},
        {"steady.memory", memory, range(1, 16), "--steady-memory", "frames, length of the memory"}};
  }
};

struct CartoonOptions {
  Mode mode = Mode::kCartoon;
  Quality quality = Quality::kFast;
  SketchOptions sketch;
  PaintOptions paint;
  EvilOptions evil;
  SkinOptions skin;
  SteadyOptions steady;

  void check() const;  // throws std::invalid_argument, which names the value
};

}  // namespace tarsier::cartoon
