// SPDX-License-Identifier: MIT
#include "tarsier/sfm/consistency/patch_evidence.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr std::size_t kMaxCompared = 300;  // max features of an image per pair
// of the longer side: max distance of matches from a feature
constexpr double kMaxMatchDistance = 0.06;
constexpr std::size_t kMapMatches = 8;  // matches that predict the position of a feature
// max distance of the feature from their mean, relative to their mean spread
constexpr double kMaxMeanOffset = 0.7;
constexpr double kMaxResidualPx = 1;   // px, of those matches
constexpr int kHalfSide = 5;           // samples, half size of a patch
constexpr double kSampleStepPx = 1.2;  // px between samples
constexpr int kSearchRadius = 2;       // samples in each direction
constexpr double kMinContrast = 5;     // grey levels: patches with less contrast are not compared
constexpr double kNoiseSigma = 3;      // grey levels, of the searched image
constexpr double kMinSameCorrelation = 0.8;       // correlation
constexpr double kMaxDifferentCorrelation = 0.4;  // correlation
constexpr int kMaxSide = 1200;                    // px
constexpr std::size_t kMaxImageBytes = std::size_t{256} << 20;
constexpr int kMinCompared = 30;                // min patches of a pair that can be rejected
constexpr std::size_t kMaxPatchNeighbours = 2;  // neighbours of an image
// min rejected pairs between the neighbours of a pair's images
constexpr int kMinNeighbourRejections = 3;
constexpr double kMinRejectedShare = 0.25;  // min share of rejected pairs in a scene that repeats
constexpr double kMinComparedRatio = 0.2;   // of the patches that an image's best pair compares
constexpr double kMinStrongRatio = 0.6;     // of the inliers of the strongest pair
constexpr double kAllowedShare = 0.004;     // share that may always differ
constexpr double kBestShareFactor = 1.5;    // factor of the best pairs' share
constexpr double kMaxSigmas = 2;

constexpr int kPatchSide = 2 * kHalfSide + 1;
constexpr int kSearchSide = kPatchSide + 2 * kSearchRadius;
constexpr int kArea = kPatchSide * kPatchSide;

// Maps the surroundings of a feature to the second image: x' = linear (x - feature) + at.
struct LocalMap {
  cv::Matx22d linear;
  cv::Vec2d at;
};

struct Correspondence {
  cv::Point2f from;
  cv::Point2f to;
};

class LocalMaps {
 public:
  LocalMaps(std::vector<Correspondence> matches, double reach)
      : matches_(std::move(matches)), reach_(reach) {}

  // Least squares over the nearest matches; empty where they do not determine it.
  std::optional<LocalMap> around(const cv::Point2f& feature) {
    near_.clear();
    for (std::size_t k = 0; k < matches_.size(); ++k) {
      const cv::Point2f d = matches_[k].from - feature;
      const float square = d.dot(d);
      if (square < reach_ * reach_) near_.emplace_back(square, k);
    }
    if (near_.size() < kMapMatches) return {};
    std::partial_sort(near_.begin(), near_.begin() + kMapMatches, near_.end());
    cv::Point2d mean(0, 0);
    for (std::size_t i = 0; i < kMapMatches; ++i) mean += offset(i, feature) * (1.0 / kMapMatches);
    double spread = 0;
    for (std::size_t i = 0; i < kMapMatches; ++i)
      spread += cv::norm(offset(i, feature) - mean) / kMapMatches;
    if (cv::norm(mean) > kMaxMeanOffset * spread) return {};

    cv::Matx33d normal = cv::Matx33d::zeros();
    cv::Matx32d right = cv::Matx32d::zeros();
    for (std::size_t i = 0; i < kMapMatches; ++i) {
      const cv::Point2d d = offset(i, feature);
      const cv::Vec3d row(d.x, d.y, 1);
      normal += row * row.t();
      right += row * target(i).t();
    }
    const cv::Matx32d map = normal.solve(right, cv::DECOMP_CHOLESKY);
    for (std::size_t i = 0; i < kMapMatches; ++i) {
      const cv::Point2d d = offset(i, feature);
      if (cv::norm(map.t() * cv::Vec3d(d.x, d.y, 1) - target(i)) > kMaxResidualPx) return {};
    }
    LocalMap result{{map(0, 0), map(1, 0), map(0, 1), map(1, 1)}, {map(2, 0), map(2, 1)}};
    const double scale = cv::determinant(result.linear);
    if (!(scale > 0.25 && scale < 4)) return {};
    return result;
  }

 private:
  [[nodiscard]] cv::Point2d offset(std::size_t i, const cv::Point2f& feature) const {
    return matches_[near_[i].second].from - feature;
  }
  [[nodiscard]] cv::Vec2d target(std::size_t i) const {
    const cv::Point2f& to = matches_[near_[i].second].to;
    return {to.x, to.y};
  }

  std::vector<Correspondence> matches_;
  double reach_;
  std::vector<std::pair<float, std::size_t>> near_;
};

// Bilinear samples of a grid of `side` x `side` around `center`; false where some are outside.
template <int side>
bool sample(const cv::Mat& gray, const cv::Vec2d& center, const cv::Matx22d& linear,
            std::array<float, static_cast<std::size_t>(side) * side>& samples) {
  constexpr int half = side / 2;
  const cv::Vec2d right = linear * cv::Vec2d(kSampleStepPx, 0);
  const cv::Vec2d down = linear * cv::Vec2d(0, kSampleStepPx);
  for (const int v : {-half, half}) {
    for (const int u : {-half, half}) {
      const cv::Vec2d corner = center + u * right + v * down;
      if (!(corner[0] >= 0 && corner[1] >= 0 && corner[0] < gray.cols - 1 &&
            corner[1] < gray.rows - 1))
        return false;
    }
  }
  std::size_t i = 0;
  for (int v = -half; v <= half; ++v) {
    for (int u = -half; u <= half; ++u, ++i) {
      const double x = center[0] + u * right[0] + v * down[0];
      const double y = center[1] + u * right[1] + v * down[1];
      const int column = std::min(static_cast<int>(x), gray.cols - 2);
      const int row = std::min(static_cast<int>(y), gray.rows - 2);
      const auto fx = static_cast<float>(x - column);
      const auto fy = static_cast<float>(y - row);
      const std::uint8_t* const above = gray.ptr(row) + column;
      const std::uint8_t* const below = gray.ptr(row + 1) + column;
      samples[i] = (above[0] * (1 - fx) + above[1] * fx) * (1 - fy) +
                   (below[0] * (1 - fx) + below[1] * fx) * fy;
    }
  }
  return true;
}

// The highest correlation of the patch at `feature` with those around the position predicted by
// `map`; empty where the patch has no contrast, or either is partly outside.
std::optional<double> correlation(const cv::Mat& gray, const cv::Point2f& feature,
                                  const cv::Mat& other, const LocalMap& map) {
  std::array<float, kArea> patch{};
  std::array<float, static_cast<std::size_t>(kSearchSide) * kSearchSide> search_area{};
  if (!sample<kPatchSide>(gray, {feature.x, feature.y}, cv::Matx22d::eye(), patch)) return {};
  if (!sample<kSearchSide>(other, map.at, map.linear, search_area)) return {};
  float mean = 0;
  for (const float value : patch) mean += value / kArea;
  float square = 0;
  for (float& value : patch) {
    value -= mean;
    square += value * value;
  }
  if (square < kMinContrast * kMinContrast * kArea) return {};
  double best = -1;
  for (int dy = 0; dy <= 2 * kSearchRadius; ++dy) {
    for (int dx = 0; dx <= 2 * kSearchRadius; ++dx) {
      float sum = 0;
      float squares = 0;
      float product = 0;
      for (int v = 0; v < kPatchSide; ++v) {
        const float* const from = &patch[at(v * kPatchSide)];
        const float* const to = &search_area[at((v + dy) * kSearchSide + dx)];
        for (int u = 0; u < kPatchSide; ++u) {
          sum += to[u];
          squares += to[u] * to[u];
          product += from[u] * to[u];  // the mean of `from` is 0
        }
      }
      const double variance = squares - static_cast<double>(sum) * sum / kArea;
      best = std::max(best,
                      product / std::sqrt(square * (variance + kNoiseSigma * kNoiseSigma * kArea)));
    }
  }
  return best;
}

void compare_one_way(const PatchImage& first, const PatchImage& second,
                     std::vector<Correspondence> matches, const std::vector<bool>& is_matched,
                     PatchEvidence& evidence) {
  std::vector<cv::Point2f> unmatched;
  for (std::size_t i = 0; i < first.features.size(); ++i)
    if (!is_matched[i]) unmatched.push_back(first.features[i]);
  LocalMaps maps(std::move(matches),
                 kMaxMatchDistance * std::max(first.gray.cols, first.gray.rows));
  std::size_t compared = 0;
  // Evenly distributed over the list; then the rest of it, where the first ones have no matches
  // around them.
  const std::size_t stride = std::max<std::size_t>(1, unmatched.size() / kMaxCompared);
  for (std::size_t begin = 0; begin < stride; ++begin) {
    for (std::size_t i = begin; i < unmatched.size() && compared < kMaxCompared; i += stride) {
      const std::optional<LocalMap> map = maps.around(unmatched[i]);
      if (!map) continue;
      const std::optional<double> best = correlation(first.gray, unmatched[i], second.gray, *map);
      if (!best) continue;
      ++compared;
      if (*best > kMinSameCorrelation) ++evidence.same;
      if (*best < kMaxDifferentCorrelation) ++evidence.differ;
    }
  }
}

// Pixels and features, reduced to at most kMaxSide.
PatchImage patch_image(const cv::Mat& gray, const std::vector<cv::Point2f>& features) {
  const double scale = static_cast<double>(kMaxSide) / std::max(gray.cols, gray.rows);
  if (gray.empty() || scale >= 1) return {gray, features};
  PatchImage result;
  cv::resize(gray, result.gray, {}, scale, scale, cv::INTER_AREA);
  for (const cv::Point2f& p : features)
    result.features.emplace_back(static_cast<float>((p.x + 0.5) * scale - 0.5),
                                 static_cast<float>((p.y + 0.5) * scale - 0.5));
  return result;
}

// For each image its certain neighbours: among its strongest pairs those whose patches differ
// least.
class Neighbourhoods {
 public:
  Neighbourhoods(const std::vector<Pair>& pairs, std::size_t images,
                 const std::vector<PatchEvidence>& evidence)
      : near_(images), best_shares_(images, 0) {
    std::vector<std::size_t> strongest(images, 0);
    for (const Pair& pair : pairs)
      for (const int image : {pair.first, pair.second})
        strongest[at(image)] = std::max(strongest[at(image)], pair.view.inliers.size());
    struct Candidate {
      double share;
      int image;
    };
    std::vector<std::vector<Candidate>> candidates(images);
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      if (pairs[k].view.inliers.empty()) continue;
      known_[{pairs[k].first, pairs[k].second}] = evidence[k];
      if (evidence[k].compared() < kMinCompared) continue;
      for (const auto& [image, other] : {std::pair(pairs[k].first, pairs[k].second),
                                         std::pair(pairs[k].second, pairs[k].first)}) {
        if (static_cast<double>(pairs[k].view.inliers.size()) <
            kMinStrongRatio * static_cast<double>(strongest[at(image)]))
          continue;
        // One is added, so that shares of few patches have less weight.
        candidates[at(image)].push_back(
            {(evidence[k].differ + 1.0) / (evidence[k].compared() + 1), other});
      }
    }
    for (std::size_t i = 0; i < images; ++i) {
      std::vector<Candidate>& all = candidates[i];
      std::sort(all.begin(), all.end(), [](const Candidate& a, const Candidate& b) {
        return std::pair(a.share, a.image) < std::pair(b.share, b.image);
      });
      near_[i].push_back(static_cast<int>(i));
      for (const Candidate& one : all) {
        if (near_[i].size() > kMaxPatchNeighbours) break;
        near_[i].push_back(one.image);
      }
      if (!all.empty()) {
        const PatchEvidence* best = find(static_cast<int>(i), all.front().image);
        best_shares_[i] = best->share();
      }
    }
  }

  // The first one is the image itself.
  [[nodiscard]] const std::vector<int>& of(int image) const { return near_[at(image)]; }
  // The share of differing patches in the best pair of an image.
  [[nodiscard]] double best_share(int image) const { return best_shares_[at(image)]; }

 private:
  [[nodiscard]] const PatchEvidence* find(int first, int second) const {
    const auto found = known_.find({std::min(first, second), std::max(first, second)});
    return found == known_.end() ? nullptr : &found->second;
  }

  std::map<std::pair<int, int>, PatchEvidence> known_;
  std::vector<std::vector<int>> near_;
  std::vector<double> best_shares_;
};

}  // namespace

PatchEvidence compare_patches(const PatchImage& first, const PatchImage& second,
                              const MatchList& inliers) {
  TARSIER_REQUIRE(first.gray.type() == CV_8UC1 && second.gray.type() == CV_8UC1,
                  "images of another type than CV_8UC1");
  std::vector<Correspondence> forward;
  std::vector<Correspondence> backward;
  std::vector<bool> is_matched_first(first.features.size(), false);
  std::vector<bool> is_matched_second(second.features.size(), false);
  for (const Match& match : inliers) {
    const cv::Point2f& a = first.features[at(match.first)];
    const cv::Point2f& b = second.features[at(match.second)];
    forward.push_back({a, b});
    backward.push_back({b, a});
    is_matched_first[at(match.first)] = is_matched_second[at(match.second)] = true;
  }
  PatchEvidence evidence;
  compare_one_way(first, second, std::move(forward), is_matched_first, evidence);
  compare_one_way(second, first, std::move(backward), is_matched_second, evidence);
  return evidence;
}

std::vector<PatchEvidence> compare_all_patches(
    const std::vector<std::vector<cv::Point2f>>& features, const std::vector<Pair>& pairs,
    const GrayImages& gray, Progress& progress, const std::stop_token& stop) {
  std::vector<PatchEvidence> evidence(pairs.size());
  progress.begin("compare patches", static_cast<std::int64_t>(pairs.size()), "pairs");
  std::map<int, PatchImage> loaded;
  std::size_t largest = std::size_t{kMaxSide} * kMaxSide;  // bytes of an image, initially a guess
  for (std::size_t start = 0; start < pairs.size();) {
    // Pairs whose images fit into memory together; at least one.
    std::set<int> needed;
    std::size_t end = start;
    for (; end < pairs.size() && (needed.size() + 2) * largest <= kMaxImageBytes; ++end) {
      if (pairs[end].view.inliers.empty()) continue;
      needed.insert(pairs[end].first);
      needed.insert(pairs[end].second);
    }
    std::erase_if(loaded, [&](const auto& one) { return !needed.contains(one.first); });
    std::vector<int> missing;
    for (const int image : needed)
      if (loaded.try_emplace(image).second) missing.push_back(image);
    cv::parallel_for_({0, static_cast<int>(missing.size())}, [&](const cv::Range& range) {
      for (int i = range.start; i < range.end && !stop.stop_requested(); ++i) {
        const int image = missing[at(i)];
        loaded.at(image) = patch_image(gray(image), features[at(image)]);
      }
    });
    throw_if_stopped(stop);
    std::size_t seen = 0;
    for (const auto& [image, known] : loaded) seen = std::max(seen, known.gray.total());
    if (seen > 0) largest = seen;
    cv::parallel_for_({static_cast<int>(start), static_cast<int>(end)},
                      [&](const cv::Range& range) {
                        for (int k = range.start; k < range.end && !stop.stop_requested(); ++k) {
                          const Pair& pair = pairs[at(k)];
                          progress.advance();
                          if (pair.view.inliers.empty()) continue;
                          const PatchImage& first = loaded.at(pair.first);
                          const PatchImage& second = loaded.at(pair.second);
                          if (first.gray.empty() || second.gray.empty()) continue;
                          evidence[at(k)] = compare_patches(first, second, pair.view.inliers);
                        }
                      });
    throw_if_stopped(stop);
    start = end;
  }
  progress.end();
  return evidence;
}

std::vector<PatchRejection> rejections_by_patches(const std::vector<Pair>& pairs,
                                                  std::size_t images,
                                                  const std::vector<PatchEvidence>& evidence) {
  const Neighbourhoods near(pairs, images, evidence);
  std::map<std::pair<int, int>, bool> differs;  // for the pairs with enough patches
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    const int compared = evidence[k].compared();
    if (pairs[k].view.inliers.empty() || compared < kMinCompared) continue;
    const double best_share =
        std::max(near.best_share(pairs[k].first), near.best_share(pairs[k].second));
    const double expected = (kAllowedShare + kBestShareFactor * best_share) * compared;
    differs[{pairs[k].first, pairs[k].second}] =
        evidence[k].differ > expected + kMaxSigmas * std::sqrt(expected);
  }
  std::vector<PatchRejection> rejections(pairs.size());
  std::vector<int> max_compared(images, 0);  // max number of compared patches of an image's pairs
  std::size_t rejected = 0;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    const int compared = evidence[k].compared();
    for (const int image : {pairs[k].first, pairs[k].second})
      max_compared[at(image)] = std::max(max_compared[at(image)], compared);
    const auto own = differs.find({pairs[k].first, pairs[k].second});
    if (own == differs.end()) continue;
    int neighbour_rejections = 0;
    int others = 0;
    for (const int first : near.of(pairs[k].first)) {
      for (const int second : near.of(pairs[k].second)) {
        const auto found = differs.find({std::min(first, second), std::max(first, second)});
        if (found == differs.end() || found == own) continue;
        ++others;
        if (found->second) ++neighbour_rejections;
      }
    }
    if (!own->second &&
        (evidence[k].differ == 0 || neighbour_rejections < kMinNeighbourRejections ||
         3 * neighbour_rejections < 2 * others))
      continue;
    ++rejected;
    rejections[k] = {fmt::format("of {} compared image patches, {} differ: the images look alike, "
                                 "but show different places",
                                 compared, evidence[k].differ),
                     true};
  }
  if (static_cast<double>(rejected) < kMinRejectedShare * static_cast<double>(differs.size()))
    return std::vector<PatchRejection>(pairs.size());
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    const int compared = evidence[k].compared();
    const int common_max =
        std::min(max_compared[at(pairs[k].first)], max_compared[at(pairs[k].second)]);
    if (pairs[k].view.inliers.empty() || rejections[k] ||
        compared >= kMinComparedRatio * common_max)
      continue;
    rejections[k].reason = fmt::format(
        "only {} patches could be compared: too few, because other places of this scene look alike",
        compared);
  }
  return rejections;
}

}  // namespace tarsier::sfm
