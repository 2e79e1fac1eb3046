// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/landmarks/face_finder.h"

#include <array>
#include <cstddef>
#include <vector>

// Merges overlapping candidates of several detectors and their scores. Internal to this module.
namespace tarsier::face::landmarks {

// Views in which the anchors search the image. A candidate that several views agree on is usually a
// face; one that only a single view sees rarely is.
struct AnchorView {
  int side = 0;  // px, see AnchorSearchOptions
  bool mirrored = false;
};
inline constexpr std::array<AnchorView, 4> kAnchorViews{
    {{416, false}, {416, true}, {320, false}, {608, false}}};
using AnchorScores = std::array<double, kAnchorViews.size()>;
// Score used for a view that does not detect the face.
inline constexpr double kMissedViewScore = 0.05;

struct ScoredCandidate {
  Candidate candidate;
  double score = 0;
  int view = -1;  // of the anchors; -1: found by other detectors
};

// Overlapping candidates, merged.
struct MergedCandidate {
  Candidate candidate;
  double detector_score = 0;
  AnchorScores anchor_scores{};
  bool only_by_anchors = true;
};

// Sorts candidates: confident ones first, then by score, then by size. Candidates that overlap an
// earlier one are merged into it.
[[nodiscard]] std::vector<MergedCandidate> merge_candidates(std::vector<ScoredCandidate> all);

// Scores them by the anchors in an image with this longer side, px. If all views searched,
// scores become the probability of a face, and probable faces become confident. A single view only
// adds candidates. Removes those with very low scores, and those that only the anchors see and that
// overlap a confident face.
void rescore_by_anchors(std::vector<MergedCandidate>& merged, bool all_views, double longer_side);

// Largest first.
[[nodiscard]] std::vector<Candidate> candidates_of(const std::vector<MergedCandidate>& merged);

}  // namespace tarsier::face::landmarks
