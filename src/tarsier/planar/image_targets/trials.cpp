// SPDX-License-Identifier: MIT
#include "tarsier/planar/image_targets/trials.h"

#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/geometry/planar_pose.h"
#include "tarsier/planar/image_targets/match.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace tarsier::planar::image_targets {
namespace {

constexpr int kWidth = 640;
constexpr int kHeight = 480;

// Homography of a print of the image's shape under a random rotation and tilt.
cv::Matx33d random_homography(cv::Size size, Rng& rng) {
  const double tilt = std::acos(rng.uniform(0.5, 1));
  const double azimuth = rng.uniform(0, 2 * std::numbers::pi);
  const double roll = rng.uniform(0, 2 * std::numbers::pi);
  const double root = std::sqrt(size.width * 1.0 * size.height);
  const double side = std::exp(rng.uniform(std::log(90.0), std::log(360.0)));
  const double scale = side / root;
  const double distance = 2.2 * root;  // in px of the image: determines the perspective
  const double c = std::cos(azimuth);
  const double s = std::sin(azimuth);
  // R = Rz(azimuth) Rx(tilt) Rz(roll - azimuth); only x and y of the plane are needed.
  const double cr = std::cos(roll - azimuth);
  const double sr = std::sin(roll - azimuth);
  const double ct = std::cos(tilt);
  const double st = std::sin(tilt);
  const cv::Matx33d turned(c * cr - s * ct * sr, -c * sr - s * ct * cr, 0,  //
                           s * cr + c * ct * sr, -s * sr + c * ct * cr, 0,  //
                           st * sr, st * cr, distance);
  const cv::Matx33d center(1, 0, -(size.width / 2.0 - 0.5), 0, 1, -(size.height / 2.0 - 0.5), 0, 0,
                           1);
  const double f = scale * distance;
  const double x = kWidth * rng.uniform(0.4, 0.6);
  const double y = kHeight * rng.uniform(0.4, 0.6);
  return cv::Matx33d(f, 0, x, 0, f, y, 0, 0, 1) * turned * center;
}

cv::Mat draw_view(const Target& target, const cv::Matx33d& h, Rng& rng) {
  // Samples the pyramid level nearest in scale, so that no pixel is skipped.
  const cv::Point2d o = geometry::mapped(h, {target.gray.cols / 2.0, target.gray.rows / 2.0});
  const cv::Point2d x = geometry::mapped(h, {target.gray.cols / 2.0 + 1, target.gray.rows / 2.0});
  const cv::Point2d y = geometry::mapped(h, {target.gray.cols / 2.0, target.gray.rows / 2.0 + 1});
  const double scale = std::sqrt(std::abs((x - o).cross(y - o)));
  cv::Mat source = target.gray;
  cv::Matx33d map = h;
  for (double rest = scale; rest < 0.6 && std::min(source.cols, source.rows) > 40; rest *= 2) {
    cv::Mat half;
    cv::resize(source, half, cv::Size(source.cols / 2, source.rows / 2), 0, 0, cv::INTER_AREA);
    const double sx = static_cast<double>(source.cols) / half.cols;
    const double sy = static_cast<double>(source.rows) / half.rows;
    map = map * cv::Matx33d(sx, 0, 0.5 * sx - 0.5, 0, sy, 0.5 * sy - 0.5, 0, 0, 1);
    source = half;
  }
  cv::Mat view(kHeight, kWidth, CV_8UC1, cv::Scalar(rng.uniform(60, 200)));
  cv::warpPerspective(source, view, map, view.size(), cv::INTER_LINEAR, cv::BORDER_TRANSPARENT);
  const double gain = rng.uniform(0.4, 1);
  const double blur = rng.uniform(0, 1.6);
  if (blur > 0.3) cv::GaussianBlur(view, view, cv::Size(0, 0), blur);
  const double noise = rng.uniform(1, 8);
  for (int r = 0; r < view.rows; ++r) {
    auto* row = view.ptr<std::uint8_t>(r);
    for (int c = 0; c < view.cols; ++c) {
      // A sum of uniform numbers: approximately normal, and much faster.
      const std::uint64_t bits = rng();
      const double n = static_cast<double>((bits & 0xFFFF) + (bits >> 16 & 0xFFFF) +
                                           (bits >> 32 & 0xFFFF) + (bits >> 48)) /
                           65536 -
                       2;
      row[c] = cv::saturate_cast<std::uint8_t>(gain * row[c] + 1.73 * noise * n);
    }
  }
  return view;
}

}  // namespace

TrialView trial_view(const Target& target, int trial, std::uint64_t seed) {
  Rng rng = Rng(seed).fork(static_cast<std::uint64_t>(trial));
  TrialView view;
  view.h = random_homography(target.size(), rng);
  view.gray = draw_view(target, view.h, rng);
  return view;
}

TrialResult run_trials(const Target& target, int trials, std::uint64_t seed,
                       const std::stop_token& stop) {
  TrialResult result;
  result.correct.assign(target.features.size(), 0);
  result.wrong.assign(target.features.size(), 0);
  FeatureOptions options;
  options.max_features = 1000;
  options.contrast = 8;
  MatchOptions matching;
  matching.max_matches = 100'000;
  for (int trial = 0; trial < trials; ++trial) {
    throw_if_stopped(stop);
    const TrialView view = trial_view(target, trial, seed);
    const FeatureSet set = find_features(make_pyramid(view.gray, true), options);
    for (const Match& m : match_features(set, target, matching)) {
      const Feature& f = set.features[static_cast<std::size_t>(m.feature)];
      const auto t = static_cast<std::size_t>(m.trained);
      const cv::Point2d d = geometry::mapped(view.h, target.features[t].at) - cv::Point2d(f.at);
      const double limit = 3 + 1.5 * static_cast<double>(f.scale);
      if (d.dot(d) < limit * limit) {
        ++result.correct[t];
      } else {
        ++result.wrong[t];
      }
    }
  }
  return result;
}

void keep_best_features(Target& target, const TrialResult& result, std::size_t max_features) {
  for (std::size_t i = 0; i < target.features.size(); ++i)
    target.features[i].correct_matches = result.correct[i];
  if (target.features.size() <= max_features) return;
  std::vector<std::size_t> order(target.features.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto score = [&](std::size_t i) { return 2 * result.correct[i] - result.wrong[i]; };
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return score(a) > score(b); });
  order.resize(max_features);
  std::sort(order.begin(), order.end());
  std::vector<TrainedFeature> features;
  std::vector<Descriptor> descriptors;
  for (const std::size_t i : order) {
    features.push_back(target.features[i]);
    descriptors.push_back(target.descriptors[i]);
  }
  target.features = std::move(features);
  target.descriptors = std::move(descriptors);
}

}  // namespace tarsier::planar::image_targets
