// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/landmarks/face_finder.h"

#include <array>
#include <cstddef>
#include <vector>

// Combines the candidates and scores of several detectors at one place. Internal to this module.
namespace tarsier::face::landmarks {

// Views in which the anchors search the image. A place that several views agree on is usually a
// face; one that only a single view sees rarely is.
struct AnchorView {
  int side = 0;  // px, see AnchorSearchOptions
  bool mirrored = false;
};
inline constexpr std::array<AnchorView, 4> kAnchorViews{
    {{416, false}, {416, true}, {320, false}, {608, false}}};
using AnchorScores = std::array<double, kAnchorViews.size()>;
// Score used for a view that does not detect the face.
inline constexpr double kAnchorUnseen = 0.05;

struct Scored {
  Candidate candidate;
  double score = 0;
  int view = -1;  // of the anchors; -1: found by other detectors
};

// The combined candidates of one place.
struct Place {
  Candidate candidate;
  double own = 0;
  AnchorScores anchored{};
  bool only_anchored = true;
};

// Sorts candidates: sure ones first, then by score, then by size. Candidates that overlap an
// earlier one are merged into its place.
[[nodiscard]] std::vector<Place> places_of(std::vector<Scored> all);

// Scores the places by the anchors in an image with this longer side, px. If all views searched,
// scores become the probability of a face, and probable faces become sure. A single view only adds
// candidates. Removes places with very low scores, and places that only the anchors see and that
// overlap a sure face.
void judge(std::vector<Place>& places, bool all_views, double longer_side);

// Largest first.
[[nodiscard]] std::vector<Candidate> candidates_of(const std::vector<Place>& places);

}  // namespace tarsier::face::landmarks
