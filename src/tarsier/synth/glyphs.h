// SPDX-License-Identifier: MIT
#pragma once

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
  };

  explicit GlyphSet(std::vector<Typeface> typefaces) : typefaces_(std::move(typefaces)) {}
  [[nodiscard]] const std::vector<Typeface>& typefaces() const { return typefaces_; }

 private:
  std::vector<Typeface> typefaces_;
};

}  // namespace tarsier::synth
