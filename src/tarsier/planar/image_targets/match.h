// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/planar/image_targets/features.h"
#include "tarsier/planar/image_targets/target.h"

#include <cstdint>
#include <vector>

namespace tarsier::planar::image_targets {

struct Match {
  std::int32_t feature = 0;  // of the frame
  std::int32_t trained = 0;  // of the target
  float ratio = 1;           // distance to it over that to the best one at another place
  float distance = 0;
};

struct MatchOptions {
  int candidates = 12;       // by sketch, that are compared in full
  int max_bits = 66;         // that differ of a candidate's sketch's 256
  float ratio = 0.92F;       // matches from here on are left out
  float elsewhere = 0.035F;  // of the image's diagonal: farther away is another place
  std::size_t most = 300;    // the best by ratio

  [[nodiscard]] OptionFields fields() {
    return {{"candidates", candidates, range(2, 64)},
            {"max_bits", max_bits, range(0, 256)},
            {"ratio", ratio, above(0)},
            {"elsewhere", elsewhere, range(0, 1)},
            {"most", most, range(1, 1'000'000)}};
  }
  void check() const { check_fields(*this); }  // throws std::invalid_argument
};

// For each feature of the frame the target's most alike, best ratio first. Throws
// std::invalid_argument for bad options.
[[nodiscard]] std::vector<Match> match_features(const FeatureSet& frame, const Target& target,
                                                const MatchOptions& options);

// A guess of where the target is, with how many matches agree.
struct Hypothesis {
  cv::Matx33d h;  // px of the frame from px of the image
  double score = 0;
  int support = 0;  // matches at distinct places
};

// Each match alone tells a place, a scale, a turn and, by the view it was trained in, a tilt: an
// affine map. The best `most` of these maps, each the least-squares refined from the matches that
// agree with it in place, scale and turn (a local optimisation as in LO-RANSAC: Chum, Matas and
// Kittler, DAGM 2003, without its random part: every match is tried).
[[nodiscard]] std::vector<Hypothesis> find_hypotheses(const FeatureSet& frame, const Target& target,
                                                      const std::vector<Match>& matches,
                                                      std::size_t most);

}  // namespace tarsier::planar::image_targets
