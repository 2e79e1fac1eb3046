// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"

#include <opencv2/core.hpp>

#include <array>
#include <cstddef>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::synth {

// The symbols that plates are lettered with.
inline constexpr std::string_view kPlateSymbols = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ";

// Coverage masks (CV_8UC1, cut to the ink) of kPlateSymbols in several typefaces, each in several
// weights from thin to heavy. Any number of threads may ask for masks at a time.
class GlyphSet {
 public:
  static constexpr int kCapHeight = 112;  // px of a capital letter
  static constexpr int kWeights = 5;      // index 2 is the typeface's own
  struct Typeface {
    std::string name;
    std::array<cv::Mat, kPlateSymbols.size()> masks;  // of its own weight
    bool has_weights = true;                          // false: its only weight is its own
    double digit_aspect = 0.6;  // widest digit's width by the capital's height
    int share = 1;              // how often it is picked, relative to the others
  };

  explicit GlyphSet(std::vector<Typeface> typefaces);
  [[nodiscard]] const std::vector<Typeface>& typefaces() const { return typefaces_; }
  // The mask of a symbol of kPlateSymbols; other weights than the typeface's own are made when they
  // are asked for first.
  [[nodiscard]] const cv::Mat& mask(int typeface, int weight, std::size_t symbol) const;
  // A random typeface's number.
  [[nodiscard]] int pick(Rng& rng) const;

 private:
  struct Reweighted {
    std::once_flag once;
    cv::Mat mask;
  };
  std::vector<Typeface> typefaces_;
  std::unique_ptr<Reweighted[]> reweighted_;  // by typeface, weight and symbol
  std::vector<int> shared_;                   // each typeface's number as often as its share
};

}  // namespace tarsier::synth
