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
  int candidates = 10;  // maximum number of returned texts
  int beam = 48;
  double free_penalty = 6;     // nats subtracted from a text that fits no layout
  double layout_strength = 1;  // exponent of the layouts' weights
  // Bonus of a text whose layout allows few symbols (a digit is one of 10, not of 36). 0 gives no
  // bonus. 1 is the exact value if plates were drawn from their layouts and the classifier was
  // trained on random symbols.
  double specificity = 0.75;
  int min_length = 4;  // of free texts
  int max_length = 10;

  [[nodiscard]] OptionFields fields() {
    return {{"candidates", candidates, range(1, 100)},
            {"beam", beam, range(4, 1000)},
            {"free_penalty", free_penalty, range(0, 50), "--free-penalty",
             "nats, penalty of texts that match no country's layout"},
            {"layout_strength", layout_strength, range(0, 10)},
            {"specificity", specificity, range(0, 1)},
            {"min_length", min_length, range(1, 12)},
            {"max_length", max_length, range(1, 12)}};
  }
  void check() const;
};

struct DecodedText {
  std::string text;
  double log_score = 0;  // natural logarithm: acoustic + prior, not normalised
  double acoustic = 0;   // the first part: log probability of the text in the columns alone
  double posterior = 0;  // probability of this text among all texts in the final beam, 0..1
  std::string country;   // code; empty for a free text
  int layout = -1;       // index in the choice's layouts; -1 for a free text
  // One value per character, 0..1. It is taken at the character's clearest column of the best
  // alignment: the probability of the symbol, divided by the sum over the blank and the symbols
  // that the layouts allow after the characters before it.
  std::vector<double> confidences;
  std::vector<std::pair<int, int>> columns;  // first and last column of each character
};

// Finds the most probable texts for a row of class probabilities. As in connectionist temporal
// classification (Graves et al., ICML 2006), the probability of a text is the sum over all
// alignments, and equal neighbours merge unless a blank lies between them. The search is a prefix
// beam search: each prefix carries the set of layouts that it can still complete. If the choice
// allows free texts, prefixes without a possible layout compete in a separate beam, and complete
// ones at `free_penalty`. The object is const after construction: threads may share it.
class Decoder {
 public:
  // Throws std::invalid_argument for more than 2048 layouts and for layouts whose length is outside
  // 1..12.
  explicit Decoder(CountryChoice choice, const DecodeOptions& options = {});
  ~Decoder();
  Decoder(Decoder&&) noexcept;
  Decoder& operator=(Decoder&&) noexcept;

  // `probabilities` is columns x kClasses, CV_32F; each row of the matrix sums to 1. Returns the
  // most probable text first; the list may be empty if nothing fits. Throws std::invalid_argument
  // for another matrix.
  [[nodiscard]] std::vector<DecodedText> decode(const cv::Mat& probabilities) const;

  struct Tables;

 private:
  std::unique_ptr<const Tables> tables_;
};

}  // namespace tarsier::plate
