// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"

#include <opencv2/core.hpp>

#include <array>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::synth {

// The symbols that plates are lettered with.
inline constexpr std::string_view kPlateSymbols = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ";

// Coverage masks (CV_8UC1, cut to the ink) of kPlateSymbols in several typefaces, each in several
// weights from thin to heavy.
class GlyphSet {
 public:
  static constexpr int kCapHeight = 112;  // px of a capital letter
  static constexpr int kWeights = 5;      // index 2 is the typeface's own
  struct Typeface {
    std::string name;
    std::array<std::array<cv::Mat, kPlateSymbols.size()>, kWeights> masks;
    double digit_aspect = 0.6;  // widest digit's width by the capital's height
    int share = 1;              // how often it is picked, relative to the others
  };

  explicit GlyphSet(std::vector<Typeface> typefaces);
  [[nodiscard]] const std::vector<Typeface>& typefaces() const { return typefaces_; }
  // A random typeface's number.
  [[nodiscard]] int pick(Rng& rng) const;

 private:
  std::vector<Typeface> typefaces_;
  std::vector<int> shared_;  // each typeface's number as often as its share
};

}  // namespace tarsier::synth
