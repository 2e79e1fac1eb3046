// SPDX-License-Identifier: MIT
#include "tarsier/sfm/two_view/focal_estimation.h"

#include "tarsier/core/at.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/two_view/robust_two_view.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr std::size_t kMinMotionInliers = 40;
constexpr double kMaxPlaneShare = 0.7;  // share of the inliers: such pairs are left out
constexpr std::size_t kMaxPairs = 200;  // per pair of cameras
constexpr std::size_t kMaxAllPairs = 2000;
constexpr std::size_t kMaxInliers = 150;  // per pair
constexpr int kFactorsPerSide = 11;       // number of factors above and below 1
constexpr double kLogStep = 0.1;          // of the logarithms of the factors
constexpr int kFactors = 2 * kFactorsPerSide + 1;
constexpr int kMotionRounds = 8;  // iterations for refining a motion at a factor
constexpr std::size_t kFolds = 5;
constexpr double kMaxSpread = 0.1;

using Curve = std::array<double, kFactors>;  // cost for each factor

double factor_of(int k) { return std::exp(kLogStep * (k - kFactorsPerSide)); }

// Stride that takes at most `most` of `count` items, evenly.
std::size_t stride_of(std::size_t count, std::size_t max_count) {
  return std::max<std::size_t>(1, (count + max_count - 1) / max_count);
}

class Estimator {
 public:
  Estimator(const std::vector<geometry::Camera>& cameras, const std::vector<char>& is_guess,
            const std::vector<Image>& images, const std::vector<Pair>& pairs, double threshold_px)
      : cameras_(cameras),
        is_guess_(is_guess),
        images_(images),
        pairs_(pairs),
        threshold_px_(threshold_px) {}

  [[nodiscard]] std::vector<FocalEstimate> run(const std::stop_token& stop) {
    choose_pairs();
    curves_.resize(chosen_.size());
    cv::parallel_for_(cv::Range(0, static_cast<int>(chosen_.size())), [&](const cv::Range& range) {
      for (int k = range.start; k < range.end && !stop.stop_requested(); ++k)
        curves_[at(k)] = curve_of(*chosen_[at(k)]);
    });
    throw_if_stopped(stop);
    std::vector<std::size_t> all(chosen_.size());
    for (std::size_t k = 0; k < all.size(); ++k) all[k] = k;
    const std::optional<FocalEstimate> common = estimate(all);
    std::vector<FocalEstimate> result;
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
      if (is_guess_[c] == 0) continue;
      std::vector<std::size_t> own;
      for (std::size_t k = 0; k < chosen_.size(); ++k)
        if (depends_only_on(*chosen_[k], static_cast<int>(c))) own.push_back(k);
      std::optional<FocalEstimate> found = estimate(own);
      if (!found) found = common;
      if (!found) continue;
      found->camera = static_cast<int>(c);
      found->focal_px *= cameras_[c].fx;
      result.push_back(*found);
    }
    return result;
  }

 private:
  [[nodiscard]] int camera_of(int image) const { return images_[at(image)].camera; }
  [[nodiscard]] bool is_guess(int image) const { return is_guess_[at(camera_of(image))] != 0; }

  // Whether the pair depends on the focal length of this camera only.
  [[nodiscard]] bool depends_only_on(const Pair& pair, int camera) const {
    const int first = camera_of(pair.first);
    const int second = camera_of(pair.second);
    return (first == camera || !is_guess(pair.first)) &&
           (second == camera || !is_guess(pair.second)) && (first == camera || second == camera);
  }

  // For each pair of cameras, chooses pairs of images evenly from the strongest to the weakest.
  void choose_pairs() {
    std::vector<const Pair*> usable;
    for (const Pair& pair : pairs_) {
      const std::size_t inliers = pair.view.inliers.size();
      if (inliers >= kMinMotionInliers && (is_guess(pair.first) || is_guess(pair.second)) &&
          pair.view.homography_inliers < kMaxPlaneShare * static_cast<double>(inliers))
        usable.push_back(&pair);
    }
    const auto key = [&](const Pair* pair) {
      const int a = camera_of(pair->first);
      const int b = camera_of(pair->second);
      return std::pair(std::min(a, b), std::max(a, b));
    };
    std::stable_sort(usable.begin(), usable.end(), [&](const Pair* a, const Pair* b) {
      return key(a) != key(b) ? key(a) < key(b) : a->view.inliers.size() > b->view.inliers.size();
    });
    for (std::size_t from = 0; from < usable.size();) {
      std::size_t to = from;
      while (to < usable.size() && key(usable[to]) == key(usable[from])) ++to;
      const std::size_t stride = stride_of(to - from, kMaxPairs);
      for (; from < to; from += stride) chosen_.push_back(usable[from]);
      from = to;
    }
    // Where each image has its own camera, there are many pairs of cameras.
    const std::size_t stride = stride_of(chosen_.size(), kMaxAllPairs);
    for (std::size_t k = 0; k * stride < chosen_.size(); ++k) chosen_[k] = chosen_[k * stride];
    chosen_.resize((chosen_.size() + stride - 1) / stride);
  }

  // Sets the rays of a pair's inliers, with unknown focal lengths times a factor. Returns the mean
  // focal length of the two.
  double set_rays(const Pair& pair, const PointPairs& pixels, double factor,
                  PointPairs& rays) const {
    const auto set = [&](int image, const std::vector<Eigen::Vector2d>& from,
                         std::vector<Eigen::Vector2d>& to) {
      const geometry::Camera& camera = cameras_[at(camera_of(image))];
      const double focal = (is_guess(image) ? factor : 1) * camera.fx;
      to.resize(from.size());
      for (std::size_t i = 0; i < from.size(); ++i)
        to[i] = (from[i] - Eigen::Vector2d(camera.cx, camera.cy)) / focal;
      return focal;
    };
    return (set(pair.first, pixels.first, rays.first) +
            set(pair.second, pixels.second, rays.second)) /
           2;
  }

  [[nodiscard]] Curve curve_of(const Pair& pair) const {
    const geometry::Camera& first = cameras_[at(camera_of(pair.first))];
    const geometry::Camera& second = cameras_[at(camera_of(pair.second))];
    PointPairs pixels;
    const std::size_t stride = stride_of(pair.view.inliers.size(), kMaxInliers);
    std::vector<cv::Point2f> a;
    std::vector<cv::Point2f> b;
    for (std::size_t i = 0; i < pair.view.inliers.size(); i += stride) {
      a.push_back(images_[at(pair.first)].features[at(pair.view.inliers[i].first)]);
      b.push_back(images_[at(pair.second)].features[at(pair.view.inliers[i].second)]);
    }
    for (const cv::Point2d& p : undistorted(a, first)) pixels.first.emplace_back(p.x, p.y);
    for (const cv::Point2d& p : undistorted(b, second)) pixels.second.emplace_back(p.x, p.y);
    // Starts at several factors and goes outwards, as the motion at a wrong focal length may be
    // wrong.
    Curve curve;
    curve.fill(std::numeric_limits<double>::infinity());
    std::array<geometry::Rigid3, kFactors> motions;
    PointPairs rays;
    const auto sweep = [&](int from, int to, geometry::Rigid3 motion) {
      const int step = from < to ? 1 : -1;
      for (int k = from; k != to + step; k += step) {
        const double focal = set_rays(pair, pixels, factor_of(k), rays);
        const RefinedMotion refined =
            refine_motion(rays, motion, threshold_px_ / focal, kMotionRounds);
        if (refined.cost < curve[at(k)]) {
          curve[at(k)] = refined.cost;
          motions[at(k)] = refined.second_from_first;
        }
        motion = motions[at(k)];
      }
    };
    const auto sweep_from = [&](int k, const geometry::Rigid3& motion) {
      if (!(motion.translation.norm() > 0)) return;  // no motion was found
      sweep(k, kFactors - 1, motion);
      sweep(k, 0, motion);
    };
    sweep_from(kFactorsPerSide, pair.view.second_from_first);
    for (const int k : {kFactorsPerSide / 2, kFactors - 1 - kFactorsPerSide / 2}) {
      const double focal = set_rays(pair, pixels, factor_of(k), rays);
      sweep_from(k, robust_motion(rays, {.threshold = threshold_px_ / focal}).second_from_first);
    }
    // A pair without finite costs has no influence.
    if (!std::all_of(curve.begin(), curve.end(), [](double cost) { return std::isfinite(cost); }))
      curve.fill(0);
    return curve;
  }

  // The logarithm of the factor with the lowest sum of curves; empty where it is the first or the
  // last.
  static std::optional<double> minimum_of(const Curve& sum) {
    const auto lowest = std::min_element(sum.begin(), sum.end()) - sum.begin();
    if (lowest == 0 || lowest == kFactors - 1) return std::nullopt;
    const double before = sum[static_cast<std::size_t>(lowest - 1)];
    const double lowest_cost = sum[static_cast<std::size_t>(lowest)];
    const double after = sum[static_cast<std::size_t>(lowest + 1)];
    const double curvature = before - 2 * lowest_cost + after;
    const double shift = curvature > 0 ? (before - after) / (2 * curvature) : 0;
    return kLogStep * (static_cast<double>(lowest) - kFactorsPerSide + shift);
  }

  // Estimates the factor (in focal_px) and its spread from the pairs `among`.
  [[nodiscard]] std::optional<FocalEstimate> estimate(const std::vector<std::size_t>& among) const {
    if (among.size() < kFolds) return std::nullopt;
    std::array<Curve, kFolds> folds{};
    Curve all{};
    for (std::size_t k = 0; k < among.size(); ++k) {
      for (std::size_t f = 0; f < kFactors; ++f) {
        folds[k % kFolds][f] += curves_[among[k]][f];
        all[f] += curves_[among[k]][f];
      }
    }
    const std::optional<double> best = minimum_of(all);
    if (!best) return std::nullopt;
    std::array<double, kFolds> without{};  // jackknife
    double mean = 0;
    for (std::size_t j = 0; j < kFolds; ++j) {
      Curve rest = all;
      for (std::size_t f = 0; f < kFactors; ++f) rest[f] -= folds[j][f];
      const std::optional<double> found = minimum_of(rest);
      if (!found) return std::nullopt;
      without[j] = *found;
      mean += *found / kFolds;
    }
    double squares = 0;
    for (const double found : without) squares += (found - mean) * (found - mean);
    FocalEstimate result;
    result.focal_px = std::exp(*best);
    result.spread = std::sqrt(squares * (kFolds - 1) / kFolds);
    result.pairs = static_cast<int>(among.size());
    if (result.spread > kMaxSpread) return std::nullopt;
    return result;
  }

  const std::vector<geometry::Camera>& cameras_;
  const std::vector<char>& is_guess_;
  const std::vector<Image>& images_;
  const std::vector<Pair>& pairs_;
  double threshold_px_;
  std::vector<const Pair*> chosen_;
  std::vector<Curve> curves_;  // for `chosen_`
};

}  // namespace

std::vector<FocalEstimate> estimate_focal_lengths(const std::vector<geometry::Camera>& cameras,
                                                  const std::vector<char>& is_guess,
                                                  const std::vector<Image>& images,
                                                  const std::vector<Pair>& pairs,
                                                  double threshold_px,
                                                  const std::stop_token& stop) {
  return Estimator(cameras, is_guess, images, pairs, threshold_px).run(stop);
}

}  // namespace tarsier::sfm
