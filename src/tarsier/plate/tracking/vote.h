// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/plate/text/reading.h"

#include <string>
#include <vector>

// One text from the readings of many frames.
namespace tarsier::plate {

struct Ballot {
  std::vector<Candidate> candidates;  // of one reading, best first; not empty
  // One for each character of the first candidate, 0..1; or empty: unknown.
  std::vector<double> characters;
  double height_px = 0;  // of a row of the plate; larger plates count more
};

// The ballot of a reading; of its candidates the first five.
[[nodiscard]] Ballot ballot_of(const Reading& reading);

struct VoteOptions {
  // By how many nats a text of some country's layout is preferred to one of none.
  double layout_bonus = 1;
  // Frames of one vehicle fail together: however many there are, they count as this many
  // independent ones in the confidence.
  double independent = 3;
  int candidates = 5;  // how many texts are returned

  [[nodiscard]] OptionFields fields() {
    return {{"layout_bonus", layout_bonus, range(0, 20)},
            {"independent", independent, range(1, 100)},
            {"candidates", candidates, range(1, 100)}};
  }
  void check() const { check_fields(*this); }
};

// How much a ballot counts, before others are known: by its confidence and the height relative to
// the highest of the vehicle's plates.
[[nodiscard]] double weight_of(const Ballot& ballot, double highest_px);

// The texts that the ballots speak for, best first; their confidences add up to 1 at most. The
// votes are the candidates of all ballots and what comes of voting on each character. A text's
// score is the weighted sum of logarithms of what each ballot gives it (a product of experts;
// Genest and Zidek, Statistical Science 1986): its probability as a candidate, or that of a
// candidate a few edits away times what these edits cost, less where the character was doubtful;
// never below a floor, so that one bad frame cannot forbid a text. The k-th best ballot counts 1 /
// (1 + k / 5): many poor frames do not outvote good ones. Empty for no ballots.
[[nodiscard]] std::vector<Candidate> vote(const std::vector<Ballot>& ballots,
                                          const VoteOptions& options);

}  // namespace tarsier::plate
