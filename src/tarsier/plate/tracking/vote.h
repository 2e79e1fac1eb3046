// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/plate/text/reading.h"

#include <string>
#include <vector>

// Votes one text from the readings of many frames.
namespace tarsier::plate {

struct Ballot {
  std::vector<Candidate> candidates;  // of one reading, best first; not empty
  // Confidence of each character of the first candidate, 0..1. Empty if not known.
  std::vector<double> characters;
  double height_px = 0;  // of a row of the plate; larger plates have more weight
};

// The ballot of a reading, with its first five candidates.
[[nodiscard]] Ballot ballot_of(const Reading& reading);

struct VoteOptions {
  // Bonus in nats for a text that fits a country's layout.
  double layout_bonus = 1;
  // The frames of one vehicle have correlated errors. In the confidence, any number of frames
  // counts as at most this many independent ones.
  double independent = 3;
  int candidates = 5;  // number of returned texts

  [[nodiscard]] OptionFields fields() {
    return {{"layout_bonus", layout_bonus, range(0, 20)},
            {"independent", independent, range(1, 100)},
            {"candidates", candidates, range(1, 100)}};
  }
  void check() const { check_fields(*this); }
};

// Weight of a ballot before it is ranked among the others: from its confidence, and its height
// relative to the highest plate of the vehicle.
[[nodiscard]] double weight_of(const Ballot& ballot, double highest_px);

// Returns the texts that the ballots support, best first; their confidences sum to at most 1. The
// texts considered are the candidates of all ballots and the result of voting on each character.
// The score of a text is a weighted sum over the ballots of ln p (a product of experts; Genest and
// Zidek, Statistical Science 1986).
// p is the text's probability as a candidate of the ballot, or that of a candidate a few edits away
// times the cost of these edits, which is lower for doubtful characters. A floor of p keeps one bad
// frame from excluding a text. The k-th best ballot has the weight 1 / (1 + k / 5), so that many
// poor frames do not outvote good ones. Returns an empty list for no ballots.
[[nodiscard]] std::vector<Candidate> vote(const std::vector<Ballot>& ballots,
                                          const VoteOptions& options);

}  // namespace tarsier::plate
