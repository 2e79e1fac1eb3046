// SPDX-License-Identifier: MIT
#include "tarsier/sfm/consistency/repeated_structure.h"

#include "tarsier/core/at.h"
#include "tarsier/sfm/consistency/image_cells.h"

#include <algorithm>
#include <cstddef>

namespace tarsier::sfm {
namespace {

constexpr int kMinCellInliers = 2;            // min inliers of a pair in a cell that it covers
constexpr int kMinMatchingPairs = 2;          // min pairs that match a feature
constexpr int kMinCoveringPairs = 4;          // min pairs that cover it
constexpr double kMaxRareFeatureRatio = 0.5;  // of the rate of most features
// quantile of the rates that defines the rate of most features
constexpr double kFeatureQuantile = 0.75;

// The pairs of one image.
class ImageEvidence {
 public:
  ImageEvidence(const Image& image, const geometry::Camera& camera) {
    for (const cv::Point2f& p : image.features) cells_.push_back(image_cell(p, camera));
    covering_pairs_.assign(cells_.size(), 0);
    matching_pairs_.assign(cells_.size(), 0);
  }

  // `features`: those that the pair matches.
  void add(std::size_t pair, std::vector<int> features) {
    std::vector<int> inliers(kImageCells, 0);
    for (const int f : features) {
      ++inliers[at(cells_[at(f)])];
      ++matching_pairs_[at(f)];
    }
    for (std::size_t f = 0; f < cells_.size(); ++f)
      covering_pairs_[f] += inliers[at(cells_[f])] >= kMinCellInliers ? 1 : 0;
    pairs_.push_back({pair, std::move(features), std::move(inliers)});
  }

  void evaluate(std::vector<PairEvidence>& evidence) const {
    std::vector<double> rates;
    for (std::size_t f = 0; f < cells_.size(); ++f)
      if (is_known(f))
        rates.push_back(static_cast<double>(matching_pairs_[f]) / covering_pairs_[f]);
    if (rates.empty()) return;
    const auto typical_rate =
        rates.begin() +
        static_cast<std::ptrdiff_t>(kFeatureQuantile * static_cast<double>(rates.size() - 1));
    std::nth_element(rates.begin(), typical_rate, rates.end());
    const double max_rare_rate = kMaxRareFeatureRatio * *typical_rate;
    for (const CoveringPair& pair : pairs_) {
      std::vector<char> has(cells_.size(), 0);
      for (const int f : pair.features) has[at(f)] = 1;
      double all_expected = 0;
      int all_found = 0;
      double expected = 0;
      int found = 0;
      for (std::size_t f = 0; f < cells_.size(); ++f) {
        if (!is_known(f) || pair.inliers[at(cells_[f])] < kMinCellInliers) continue;
        const double rate =
            static_cast<double>(matching_pairs_[f] - has[f]) / (covering_pairs_[f] - 1);
        all_expected += rate;
        all_found += has[f];
        if (matching_pairs_[f] >= max_rare_rate * covering_pairs_[f]) continue;
        expected += rate;
        found += has[f];
      }
      if (!(all_expected > 0)) continue;
      evidence[pair.pair].expected += expected * std::min(1.0, all_found / all_expected);
      evidence[pair.pair].found += found;
    }
  }

 private:
  struct CoveringPair {
    std::size_t pair;
    std::vector<int> features;
    std::vector<int> inliers;  // per cell
  };
  [[nodiscard]] bool is_known(std::size_t f) const {
    return matching_pairs_[f] >= kMinMatchingPairs && covering_pairs_[f] >= kMinCoveringPairs;
  }
  std::vector<int> cells_;  // for each feature
  std::vector<int> covering_pairs_;
  std::vector<int> matching_pairs_;
  std::vector<CoveringPair> pairs_;
};

}  // namespace

std::vector<PairEvidence> check_evidence(const std::vector<geometry::Camera>& cameras,
                                         const std::vector<Image>& images,
                                         const std::vector<Pair>& pairs) {
  std::vector<PairEvidence> evidence(pairs.size());
  std::vector<std::vector<std::size_t>> pairs_of(images.size());
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    if (pairs[k].view.inliers.empty()) continue;
    pairs_of[at(pairs[k].first)].push_back(k);
    pairs_of[at(pairs[k].second)].push_back(k);
  }
  for (std::size_t i = 0; i < images.size(); ++i) {
    if (static_cast<int>(pairs_of[i].size()) < kMinCoveringPairs) continue;
    ImageEvidence image(images[i], cameras[at(images[i].camera)]);
    for (const std::size_t k : pairs_of[i]) {
      const bool is_first = pairs[k].first == static_cast<int>(i);
      std::vector<int> features;
      for (const Match& match : pairs[k].view.inliers)
        features.push_back(is_first ? match.first : match.second);
      image.add(k, std::move(features));
    }
    image.evaluate(evidence);
  }
  return evidence;
}

}  // namespace tarsier::sfm
