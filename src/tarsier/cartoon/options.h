// SPDX-License-Identifier: MIT
#pragma once

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
  kReference,  // the definition, in plain OpenCV calls
  kFast,       // the same picture (bit-exact masks, painting >= 45 dB) from vector kernels
  kDraft,      // fewer painting rounds: for small machines
};
[[nodiscard]] std::string_view name_of(Quality quality);
[[nodiscard]] Quality parse_quality(std::string_view name);

// Pencil lines: grey, median, Laplacian (8-bit, so only its positive side), inverse threshold.
struct SketchOptions {
  int median_size = 7;     // px, odd, 3..7
  int laplacian_size = 5;  // aperture, 1, 3, 5 or 7
  int threshold = 80;      // of the Laplacian response, 0..255; a line where it is above
  // A black pixel whose 5x5 border is all white has its 3x3 centre whitened.
  bool remove_pepper = true;
};

// Oil painting: bilateral filters on the half-size picture.
struct PaintOptions {
  int rounds = 7;          // of two bilateral filters each, 0..50
  int diameter = 9;        // px, odd, 3..15
  double sigma_color = 9;  // grey levels, (0, 255]
  double sigma_space = 7;  // px, (0, 100]
};

// Thick dark lines: 3x3 Scharr in +x and -x added (and +y, -y), inverse threshold, median.
struct EvilOptions {
  bool both_axes = false;  // --evil-axes xy
  int threshold = 12;      // 0..255
  int median_size = 3;     // px, odd, 1 (none)..7
};

enum class SkinStyle {
  kGlow,  // `color` is added to the skin
  kTint,  // the skin keeps its brightness and takes the hue and saturation of `color`
};
enum class FaceMode {
  kOutline,  // the user puts the face into the outline; six seeds in the middle of the picture
  kAuto,     // faces are found, and each one's skin colour learned
};

// Skin: flood fill from six points of the face outline, bounded by edges, in Y'CrCb.
struct SkinOptions {
  FaceMode face = FaceMode::kOutline;
  SkinStyle style = SkinStyle::kGlow;
  cv::Scalar color{0, 70, 0};            // BGR, each 0..255
  int edge_threshold = 80;               // of the half-size Laplacian response, 0..255
  std::array<int, 3> lower{60, 25, 20};  // Y', Cr, Cb below the seed, 0..255
  std::array<int, 3> upper{80, 15, 15};  // above the seed
  double learned_distance = 2.6;  // kAuto: Mahalanobis distance in CrCb that is still skin, (0, 10]
  // kAuto: the cascade file that finds faces; empty: OpenCV's, see face::find_cascade().
  std::string cascade;
};

// Whether the skin of a mode is looked for.
[[nodiscard]] bool uses_skin(Mode mode);

// Fewer flickering lines in video. See stabilize.h.
struct SteadyOptions {
  bool on = false;
  // Share of the threshold either side of it in which a line keeps its state, 0..0.9.
  double hysteresis = 0.3;
  int motion = 10;  // change of the median grey above which a pixel counts as moved, 1..255
  int memory = 6;   // frames that a still pixel is averaged over, 1..16
};

struct CartoonOptions {
  Mode mode = Mode::kCartoon;
  Quality quality = Quality::kFast;
  SketchOptions sketch;
  PaintOptions paint;
  EvilOptions evil;
  SkinOptions skin;
  SteadyOptions steady;

  void check() const;  // throws std::invalid_argument, naming the value
};

}  // namespace tarsier::cartoon
