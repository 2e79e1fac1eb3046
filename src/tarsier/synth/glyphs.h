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

// The symbols on plates.
inline constexpr std::string_view kPlateSymbols = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ";

// Coverage masks (CV_8UC1, cropped to the ink) of kPlateSymbols in several typefaces, each in
// several weights from thin to heavy. Any number of threads may use it.
class GlyphSet {
 public:
  static constexpr int kCapHeight = 112;  // px of a capital letter
  static constexpr int kWeights = 5;      // index 2 is the typeface's own weight
  struct Typeface {
    std::string name;
    std::array<cv::Mat, kPlateSymbols.size()> masks;  // in its own weight
    bool has_weights = true;                          // false: only its own weight exists
    double digit_aspect = 0.6;                        // width of the widest digit / cap height
    int share = 1;                                    // relative frequency in pick()
  };

  explicit GlyphSet(std::vector<Typeface> typefaces);
  [[nodiscard]] const std::vector<Typeface>& typefaces() const { return typefaces_; }
  // The mask of a symbol of kPlateSymbols. Weights other than the typeface's own are made at the
  // first request.
  [[nodiscard]] const cv::Mat& mask(int typeface, int weight, std::size_t symbol) const;
  // Index of a random typeface.
  [[nodiscard]] int pick(Rng& rng) const;

 private:
  struct Reweighted {
    std::once_flag once;
    cv::Mat mask;
  };
  std::vector<Typeface> typefaces_;
  std::unique_ptr<Reweighted[]> reweighted_;  // by typeface, weight and symbol
  std::vector<int> shared_;                   // the index of each typeface, repeated `share` times
};

}  // namespace tarsier::synth
