// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/text/decode.h"

#include <opencv2/core/mat.hpp>

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

// The inside of the decoder.
namespace tarsier::plate {

inline constexpr int kSymbols = kBlank;
inline constexpr std::size_t kMaxPlaces = 12;
inline constexpr std::size_t kMaxLayouts = 2048;

// What is known before any image. Sets of layouts are bits that number them by falling prior: the
// first of a set is its best.
struct Decoder::Tables {
  CountryChoice choice;
  DecodeOptions options;
  std::size_t words = 1;            // of a set of layouts
  std::vector<std::uint64_t> fit;   // layouts that allow a symbol at a place
  std::vector<std::size_t> order;   // numbers in choice.layouts by rank
  std::vector<double> prior;        // by rank, natural logarithm
  std::vector<std::size_t> length;  // by rank, places

  Tables(CountryChoice given, const DecodeOptions& how);

  [[nodiscard]] std::size_t index(std::size_t place, int symbol) const {
    return (place * kSymbols + static_cast<std::size_t>(symbol)) * words;
  }

  // Calls take(rank) for each layout of the set, best first, until it returns true.
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
  void add_places(std::size_t rank, const Layout& layout);
};

// The texts that the beam holds at the end, in any order, with what it knows of their scores. A
// wide search has a larger beam and follows up nearly every symbol.
[[nodiscard]] std::vector<Decoded> search_texts(const Decoder::Tables& tables,
                                                const cv::Mat& probabilities, bool wide);

}  // namespace tarsier::plate
