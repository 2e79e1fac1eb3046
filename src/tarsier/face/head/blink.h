// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <array>
#include <deque>

// Detects blinks of a face in a video from the lid points and the eyes' pixels. A shut eye is
// compared with the same eye shortly before and after, so that no threshold depends on the person.
//
// The eyes are sampled at positions given by an affine map A from a reference face, so that they
// stay similar when a flat image of a face is moved, turned or nodded. c(i, j) is the correlation
// of the eyes of two frames, and o the lid distance relative to that of the mapped reference lids.
// A blink is a shut frame s between an open one b before and the present one a (Soukupova and Cech
// 2016 use o alone, with a learnt temporal window):
//   closing = 1 - o(s) / min(o(b), o(a))
//   change  = min c(b, a) - max(max c(b, s), max c(s, a))    min, max: of both eyes
// s is the frame least similar to a; b is the frame before s that is most similar to a.
namespace tarsier::face::head {

using AffineMap = Eigen::Matrix<double, 2, 3>;

inline constexpr Eigen::Index kFacePoints = 68;  // iBUG's
inline constexpr int kEyeWidth = 32;             // samples
inline constexpr int kEyeHeight = 20;
// Both eyes, each with its mean subtracted and norm 1 (or zero, if uniform).
using EyePatches = std::array<Eigen::VectorXf, 2>;

// The eyes of `image` (8 bits, 1 or 3 channels, BGR) with some surroundings, at the positions to
// which `map` moves those of `reference` (68 points). Outside the image, the border is replicated.
// Throws std::invalid_argument for other image types and other points.
[[nodiscard]] EyePatches eye_patches(const cv::Mat& image, const Eigen::Matrix2Xd& reference,
                                     const AffineMap& map);

struct BlinkOptions {
  double min_closing = 0.05;
  double min_change = 0.06;
  double longest_s = 1.5;  // from b to a

  [[nodiscard]] OptionFields fields() {
    return {{"min_closing", min_closing, range(0, 1)},
            {"min_change", min_change, range(0, 2)},
            {"longest_s", longest_s, range(0.05, 10)}};
  }
  void check() const { check_fields(*this); }  // throws std::invalid_argument
};

class BlinkDetector {
 public:
  // Throws std::invalid_argument for bad options.
  explicit BlinkDetector(const BlinkOptions& options) : options_(options) { options_.check(); }
  // Processes the next frame of the same face with its `lids` (o above) and `eyes`, at `time` (s,
  // rising). Returns true if the frame ends a blink; the detector is then reset.
  bool step(double time, double lids, EyePatches eyes);
  void clear() { frames_.clear(); }

 private:
  struct Frame {
    double time = 0;
    double lids = 1;
    EyePatches eyes;
  };
  BlinkOptions options_;
  std::deque<Frame> frames_;
};

}  // namespace tarsier::face::head
