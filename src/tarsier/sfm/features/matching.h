// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/sfm/features/features.h"
#include "tarsier/sfm/features/match_list.h"

#include <vector>

namespace tarsier::sfm {

struct MatchOptions {
  // A nearest neighbour is accepted if its distance is below this times that of the second nearest
  // (Lowe, IJCV 2004).
  double ratio = 0.8;

  [[nodiscard]] OptionFields fields() {
    return {{"ratio", ratio, range(0.1, 1), "--ratio",
             "maximum ratio of the best to the second best descriptor distance"}};
  }
  void check() const { check_fields(*this); }
};

// Similarity of two descriptors: the cosine of their angle, or the share of equal bits scaled to
// -1..1.
[[nodiscard]] double similarity(const cv::Mat& first, int row, const cv::Mat& second, int other,
                                FeatureKind kind);
// The same with the known product of the two descriptors' norms.
[[nodiscard]] double similarity(const cv::Mat& first, int row, const cv::Mat& second, int other,
                                FeatureKind kind, double norms);
// The norm of each row; 1 for bits.
[[nodiscard]] std::vector<double> norms_of(const cv::Mat& descriptors, FeatureKind kind);

// Mutual nearest neighbours that pass the ratio test in both directions, sorted by `first`. Exact:
// all distances are computed (find_nearest() of nearest.h). `ratios` may be null. It receives, for
// each match, the ratio of the two best squared distances (for bits: of the distances), 0..1.
// Throws std::invalid_argument where the kinds differ.
[[nodiscard]] std::vector<Match> match_features(const cv::Mat& first, const cv::Mat& second,
                                                FeatureKind kind, const MatchOptions& options,
                                                std::vector<float>* ratios = nullptr);

// The same for points with several descriptors (Features::owners). All descriptors at one position
// of an image count as one: the second nearest neighbour is the nearest at another position.
// Otherwise the descriptors of one position would fail the ratio test against each other. A match
// names the first point at each of its two positions, and a position has at most one match. Without
// owners: as above.
[[nodiscard]] std::vector<Match> match_features(const Features& first, const Features& second,
                                                FeatureKind kind, const MatchOptions& options,
                                                std::vector<float>* ratios = nullptr);

}  // namespace tarsier::sfm
