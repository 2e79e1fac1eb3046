// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <array>
#include <deque>

// Blinks of a face in a video, by the lids' points and by the eyes' pixels, with no threshold that
// depends on the person: a shut eye is compared with the same eye shortly before and after.
//
// A frame's eyes are sampled at the places that an affine map A takes from a reference face, so that
// they stay alike when a flat image of a face is moved, turned or nodded. With the correlation
// c(i, j) of the eyes of two frames and the lids' distance o, relative to that of A lids, a blink is
// a shut frame s between an open one b before and the present one a (Soukupova and Cech 2016 use o
// alone, with a learnt temporal window):
//   closing = 1 - o(s) / min(o(b), o(a))
//   change  = min c(b, a) - max(max c(b, s), max c(s, a))    min, max: of both eyes
// s is the frame most unlike a, b the frame before s most like a.
namespace tarsier::face::head {

using AffineMap = Eigen::Matrix<double, 2, 3>;

inline constexpr int kEyeWidth = 32;  // samples
inline constexpr int kEyeHeight = 20;
// Both eyes, each less its mean and of norm 1 (or zero, where it is of one colour).
using EyePatches = std::array<Eigen::VectorXf, 2>;

// The eyes of `image` (8 bits, 1 or 3 channels, BGR), with some of what is about them, at the places that
// `map` takes from `reference` (68 points). Places beyond the image repeat its edge.
// Throws std::invalid_argument for other images and other points.
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
  // The next frame of the same face, of which `lids` (o above) and `eyes` are known, at `time` (s,
  // rising). True where it ends a blink; the detector begins again then.
  bool step(double time, double lids, EyePatches eyes);
  void clear() { frames_.clear(); }

 private:
  struct Seen {
    double time = 0;
    double lids = 1;
    EyePatches eyes;
  };
  BlinkOptions options_;
  std::deque<Seen> frames_;
};

}  // namespace tarsier::face::head
