// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/merged_candidates.h"

#include "tarsier/core/boxes.h"
#include "tarsier/core/statistics.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace tarsier::face::landmarks {
namespace {

// Share of the longer side; the anchors often miss smaller faces.
constexpr double kMinAnchorShare = 0.08;
// Joint score of all detectors: confident from here on; below the second value not, whatever the
// networks' score.
constexpr double kMinJointScore = 0.3;
constexpr double kMaxUnlikelyScore = 0.15;
// A candidate that only the anchors detect needs at least this score.
constexpr double kMinAnchorScore = 0.02;
constexpr double kMinSingleViewScore = 0.3;  // the same for one that only one view has searched for

double logit(double p) {
  const double inside = std::clamp(p, kMissedViewScore, 0.999);
  return std::log(inside / (1 - inside));
}

// Probability of a face at a place with the `detector_score` of networks or cascades and the scores
// `anchor_scores` of the views (0: not detected). A logistic regression on 370 images of faces68,
// more than half of them disguised, and 235 images without faces.
double joint_score(double detector_score, const AnchorScores& anchor_scores) {
  constexpr double kDetectorWeight = 0.497;
  constexpr double kAnchorWeight = 3.81;
  constexpr double kBias = 6.93;
  double sum = 0;
  for (const double score : anchor_scores) sum += logit(score);
  const double mean_logit = sum / static_cast<double>(anchor_scores.size());
  return logistic(kDetectorWeight * logit(detector_score) + kAnchorWeight * mean_logit + kBias);
}

}  // namespace

std::vector<MergedCandidate> merge_candidates(std::vector<ScoredCandidate> all) {
  std::stable_sort(all.begin(), all.end(), [](const ScoredCandidate& a, const ScoredCandidate& b) {
    return std::tuple(!a.candidate.confident, -a.score, -a.candidate.box.area()) <
           std::tuple(!b.candidate.confident, -b.score, -b.candidate.box.area());
  });
  std::vector<MergedCandidate> merged;
  for (const ScoredCandidate& one : all) {
    const cv::Rect2d& box = one.candidate.box;
    auto known = std::find_if(merged.begin(), merged.end(), [&](const MergedCandidate& earlier) {
      const cv::Rect2d& better = earlier.candidate.box;
      return iou(better, box) > 0.35 || overlap_of_smaller(better, box) > 0.75;
    });
    if (known == merged.end()) {
      MergedCandidate added;
      added.candidate = one.candidate;
      known = merged.insert(known, added);
    }
    double& score = one.view < 0 ? known->detector_score
                                 : known->anchor_scores[static_cast<std::size_t>(one.view)];
    score = std::max(score, one.candidate.score);
    known->only_by_anchors = known->only_by_anchors && one.view >= 0;
  }
  for (MergedCandidate& candidate : merged)
    if (!candidate.only_by_anchors) candidate.candidate.score = candidate.detector_score;
  return merged;
}

void rescore_by_anchors(std::vector<MergedCandidate>& merged, bool all_views, double longer_side) {
  for (MergedCandidate& one : merged) {
    const double best = *std::max_element(one.anchor_scores.begin(), one.anchor_scores.end());
    if (!all_views) {
      if (one.only_by_anchors) one.candidate.score = best >= kMinSingleViewScore ? best : 0;
      continue;
    }
    const bool large = one.candidate.box.width >= kMinAnchorShare * longer_side;
    if (best == 0 && !large) continue;
    one.candidate.score = joint_score(one.detector_score, one.anchor_scores);
    if (one.candidate.score >= kMinJointScore) one.candidate.confident = true;
    if (one.candidate.score < kMaxUnlikelyScore && large) one.candidate.confident = false;
  }
  const std::vector<MergedCandidate> before = merged;
  std::erase_if(merged, [&](const MergedCandidate& one) {
    if (!one.only_by_anchors) return false;
    if (one.candidate.score < kMinAnchorScore) return true;
    return std::any_of(before.begin(), before.end(), [&](const MergedCandidate& other) {
      return !other.only_by_anchors && other.candidate.confident &&
             overlap_of_smaller(other.candidate.box, one.candidate.box) > 0.3;
    });
  });
}

std::vector<Candidate> candidates_of(const std::vector<MergedCandidate>& merged) {
  std::vector<Candidate> kept;
  kept.reserve(merged.size());
  for (const MergedCandidate& one : merged) kept.push_back(one.candidate);
  std::stable_sort(kept.begin(), kept.end(), [](const Candidate& a, const Candidate& b) {
    return a.box.area() > b.box.area();
  });
  return kept;
}

}  // namespace tarsier::face::landmarks
