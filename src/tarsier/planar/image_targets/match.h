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
  float ratio = 1;  // distance to the best divided by that to the second best at another place
  float distance = 0;
};

struct MatchOptions {
  int candidates = 12;  // preselected by sketch and compared in full
  int max_bits = 66;    // maximum number of different bits of 256 in a candidate's sketch
  float ratio = 0.92F;  // matches with a higher ratio are rejected
  float min_separation =
      0.035F;  // relative to the image's diagonal: a larger distance is another place
  std::size_t max_matches = 300;  // maximum number of matches, best ratio first

  [[nodiscard]] OptionFields fields() {
    return {{"candidates", candidates, range(2, 64)},
            {"max_bits", max_bits, range(0, 256)},
            {"ratio", ratio, above(0)},
            {"elsewhere", min_separation, range(0, 1)},
            {"most", max_matches, range(1, 1'000'000)}};
  }
  void check() const { check_fields(*this); }  // throws std::invalid_argument
};

// The nearest feature of the target for each feature of the frame, best ratio first. Throws
// std::invalid_argument for bad options.
[[nodiscard]] std::vector<Match> match_features(const FeatureSet& frame, const Target& target,
                                                const MatchOptions& options);

// A hypothesis of the target's position, with its number of supporting matches.
struct Hypothesis {
  cv::Matx33d h;  // from px of the image to px of the frame
  double score = 0;
  int support = 0;  // supporting matches at distinct places
};

// Each match alone gives a position, scale, rotation and, from the view in which it was trained, a
// tilt: an affine map. Returns the best `max_count` of these maps, refined by least squares on the
// matches that agree in position, scale and rotation. This is a local optimisation as in LO-RANSAC
// (Chum, Matas and Kittler, DAGM 2003), but not random: every match gives a hypothesis.
[[nodiscard]] std::vector<Hypothesis> find_hypotheses(const FeatureSet& frame, const Target& target,
                                                      const std::vector<Match>& matches,
                                                      std::size_t max_count);

}  // namespace tarsier::planar::image_targets
