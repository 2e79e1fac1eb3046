// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/sfm/mapper/features.h"
#include "tarsier/sfm/mapper/match_list.h"

#include <vector>

namespace tarsier::sfm {

struct MatchOptions {
  double ratio = 0.8;  // a nearest neighbour counts if its distance is below this times the second
                       // nearest's (Lowe, IJCV 2004)

  [[nodiscard]] OptionFields fields() {
    return {{"ratio", ratio, range(0.1, 1), "--ratio", "of the two best distances"}};
  }
  void check() const { check_fields(*this); }
};

// How like each other two descriptors are: cosine of their angle, or the share of bits that agree
// scaled to -1..1.
[[nodiscard]] double similarity(const cv::Mat& first, int row, const cv::Mat& second, int other,
                                FeatureKind kind);
// The same where `norms`, the product of the two descriptors' norms, is known already.
[[nodiscard]] double similarity(const cv::Mat& first, int row, const cv::Mat& second, int other,
                                FeatureKind kind, double norms);
// Of each row; 1 for bits.
[[nodiscard]] std::vector<double> norms_of(const cv::Mat& descriptors, FeatureKind kind);

// Mutual nearest neighbours that pass the ratio test in both directions, by `first`. Exact: all
// distances are computed (find_nearest() of nearest.h). `ratios`, where not null, becomes the ratio of the
// two best squared distances of each match (of bits: of the distances), 0..1. Throws std::invalid_argument
// where the kinds differ.
[[nodiscard]] std::vector<Match> match_features(const cv::Mat& first, const cv::Mat& second,
                                                FeatureKind kind, const MatchOptions& options,
                                                std::vector<float>* ratios = nullptr);

// The same of points with several descriptors (Features::owners). What lies at one place of an image counts as one there: the
// second nearest neighbour is the nearest of another place, or the many descriptors of one place would fail the ratio test by
// each other. A match names the first point of each of its places; no place has two. Where neither has owners: as above.
[[nodiscard]] std::vector<Match> match_features(const Features& first, const Features& second,
                                                FeatureKind kind, const MatchOptions& options,
                                                std::vector<float>* ratios = nullptr);

}  // namespace tarsier::sfm
