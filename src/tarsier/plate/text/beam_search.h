// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/text/decode.h"

#include <opencv2/core/mat.hpp>

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

// Internals of the decoder.
namespace tarsier::plate {

inline constexpr int kSymbols = kBlank;
inline constexpr std::size_t kMaxPositions = 12;
inline constexpr std::size_t kMaxLayouts = 2048;

// Everything that is independent of the image. A set of layouts is a bit set. Its bits are ranks:
// the layouts are numbered by falling prior, so the first bit of a set is its most probable layout.
struct Decoder::Tables {
  CountryChoice choice;
  DecodeOptions options;
  std::size_t words = 1;  // 64-bit words of a set of layouts
  std::vector<std::uint64_t>
      fitting;                     // for each position and symbol: the set of layouts that allow it
  std::vector<std::size_t> order;  // by rank: index in choice.layouts
  std::vector<double> prior;       // by rank, natural logarithm
  std::vector<std::size_t> length;  // by rank, characters

  Tables(CountryChoice country_choice, const DecodeOptions& decode_options);

  [[nodiscard]] std::size_t index(std::size_t position, int symbol) const {
    return (position * kSymbols + static_cast<std::size_t>(symbol)) * words;
  }

  // Calls take(rank) for each layout of the set, most probable first, until take() returns true.
  template <typename Take>
  void for_each(const std::uint64_t* set, const Take& take) const {
    for (std::size_t word = 0; word < words; ++word) {
      for (std::uint64_t bits = set[word]; bits != 0; bits &= bits - 1) {
        if (take(word * 64 + static_cast<std::size_t>(std::countr_zero(bits)))) return;
      }
    }
  }

 private:
  [[nodiscard]] double prior_of(const Layout& layout, double total) const;
  void add_positions(std::size_t rank, const Layout& layout);
};

// Returns the texts in the beam after the last column, in any order, with their scores. A wide
// search uses a larger beam and expands nearly every symbol.
[[nodiscard]] std::vector<DecodedText> search_texts(const Decoder::Tables& tables,
                                                    const cv::Mat& probabilities, bool wide);

}  // namespace tarsier::plate
