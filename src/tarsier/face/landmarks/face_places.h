// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/landmarks/face_finder.h"

#include <array>
#include <cstddef>
#include <vector>

// What several detectors see at one place, and what it is worth together. Internal to this module.
namespace tarsier::face::landmarks {

// The anchors look at the image in these ways: what they agree on is a face, what only one of them
// sees rarely is.
struct AnchorView {
  int side = 0;  // px, see AnchorSearchOptions
  bool mirrored = false;
};
inline constexpr std::array<AnchorView, 4> kAnchorViews{
    {{416, false}, {416, true}, {320, false}, {608, false}}};
using AnchorScores = std::array<double, kAnchorViews.size()>;
// Score that a view counts for that does not see a face.
inline constexpr double kAnchorUnseen = 0.05;

struct Scored {
  Candidate candidate;
  double score = 0;
  int view = -1;  // of the anchors; -1: found by others
};

// Candidates of one place.
struct Place {
  Candidate candidate;
  double own = 0;
  AnchorScores anchored{};
  bool only_anchored = true;
};

// Sure ones first, then the better ones, then the larger; those that overlap an earlier one are of
// its place.
[[nodiscard]] std::vector<Place> places_of(std::vector<Scored> all);

// What the anchors make of the places in an image with this longer side, px. Where all views looked,
// scores are the probability of a face then, and sure is what is likely enough; one view alone only
// adds candidates. Places go that hardly anything speaks for, and those that only the anchors see
// between faces.
void judge(std::vector<Place>& places, bool all_views, double longer_side);

// Largest first.
[[nodiscard]] std::vector<Candidate> candidates_of(const std::vector<Place>& places);

}  // namespace tarsier::face::landmarks
