// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/plate/text/country.h"
#include "tarsier/plate/text/reading.h"

#include <opencv2/core.hpp>

#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::plate {

struct DecodeOptions {
  int candidates = 10;  // how many texts are returned at most
  int beam = 48;
  double free_penalty = 6;     // nats by which a text of no layout is less likely
  double layout_strength = 1;  // how much the layouts' weights count
  // How much it speaks for a text that its layout leaves little choice (a digit is one of 10, not
  // of 36): 0 nothing, 1 as much as it would if plates were drawn from their layouts and the
  // classifier had learnt from random symbols.
  double specificity = 0.75;
  int min_length = 4;  // of free texts
  int max_length = 10;

  [[nodiscard]] OptionFields fields() {
    return {{"candidates", candidates, range(1, 100)},
            {"beam", beam, range(4, 1000)},
            {"free_penalty", free_penalty, range(0, 50), "--free-penalty",
             "nats against texts that fit no country's layout"},
            {"layout_strength", layout_strength, range(0, 10)},
            {"specificity", specificity, range(0, 1)},
            {"min_length", min_length, range(1, 12)},
            {"max_length", max_length, range(1, 12)}};
  }
  void check() const;
};

struct Decoded {
  std::string text;
  double log_score = 0;  // natural logarithm: acoustic + prior, not normalised
  double acoustic = 0;   // its first part: probability of the text in the columns alone
  double posterior = 0;  // of this text among all that the beam kept, 0..1
  std::string country;   // code, empty where free
  int layout = -1;       // index into the choice's layouts, -1 where free
  // One a character, 0..1: at its clearest column of the text's best alignment, the symbol's share
  // among the blank and the symbols that the layouts allow after the characters before it.
  std::vector<double> confidences;
  std::vector<std::pair<int, int>> columns;  // first and last column of each character
};

// Finds the most probable texts of a row of class probabilities. As in connectionist temporal
// classification (Graves et al., ICML 2006): a text's probability is the sum over all alignments,
// equal neighbours merge unless a blank lies between. Prefix beam search in which each prefix
// carries the layouts that it can still become, in a beam of its own; texts of no layout compete at
// `free_penalty` where the choice allows them. Const after construction: may be shared by threads.
class Decoder {
 public:
  // At most 2048 layouts; throws std::invalid_argument for more, and for layouts of other lengths
  // than 1..12.
  explicit Decoder(CountryChoice choice, const DecodeOptions& options = {});
  ~Decoder();
  Decoder(Decoder&&) noexcept;
  Decoder& operator=(Decoder&&) noexcept;

  // `probabilities`: columns x kClasses, CV_32F, each row of the matrix sums to 1. Best first, may
  // be empty where nothing fits. Throws std::invalid_argument for another matrix.
  [[nodiscard]] std::vector<Decoded> decode(const cv::Mat& probabilities) const;

  [[nodiscard]] const CountryChoice& choice() const;

  struct Tables;

 private:
  std::unique_ptr<const Tables> tables_;
};

// The same once. A Decoder that is kept saves its preparation.
[[nodiscard]] std::vector<Decoded> decode(const cv::Mat& probabilities, const CountryChoice& choice,
                                          const DecodeOptions& options);

}  // namespace tarsier::plate
