// SPDX-License-Identifier: MIT
#include "tarsier/planar/image_targets/quality.h"

#include "tarsier/core/stop.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/planar/image_targets/detect.h"
#include "tarsier/planar/image_targets/trials.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace tarsier::planar::image_targets {
namespace {

constexpr int kCells = 6;               // along the image's shorter side
constexpr int kGoodFeatureCount = 120;  // number of features of a good image
constexpr int kMaxSimilarDistance =
    3500;  // squared distance of descriptors that noise makes indistinguishable
constexpr int kMinCorrectTrials = 2;  // number of trials that a feature must pass

cv::Size cells_of(cv::Size size) {
  const double side = std::min(size.width, size.height) / static_cast<double>(kCells);
  return {std::max(1, static_cast<int>(std::lround(size.width / side))),
          std::max(1, static_cast<int>(std::lround(size.height / side)))};
}

// For each feature: whether another place of the image looks the same.
std::vector<bool> find_repeated(const Target& target) {
  const auto n = target.features.size();
  std::vector<bool> repeated(n);
  std::vector<std::int32_t> index(n);
  std::vector<std::uint16_t> bits(n);
  const Kernels& kernel = kernels();
  const double min_separation = 0.06 * std::hypot(target.gray.cols, target.gray.rows);
  for (std::size_t i = 0; i < n; ++i) {
    const int count =
        kernel.search(target.descriptors[i].sketch, target.sketches.data(), static_cast<int>(n), 44,
                      static_cast<int>(n), index.data(), bits.data());
    for (int k = 0; k < count && !repeated[i]; ++k) {
      const auto j = static_cast<std::size_t>(index[static_cast<std::size_t>(k)]);
      const cv::Point2f d = target.features[j].at - target.features[i].at;
      repeated[i] = d.dot(d) > min_separation * min_separation &&
                    kernel.distance(target.descriptors[i].values.data(),
                                    target.descriptors[j].values.data()) < kMaxSimilarDistance;
    }
  }
  return repeated;
}

// The share of trials in which the target is detected at the correct position.
double detection_rate(const Target& target, int trials, std::uint64_t seed,
                      const std::stop_token& stop) {
  if (trials <= 0) return 0;
  const DetectOptions options;
  int found = 0;
  for (int trial = 0; trial < trials; ++trial) {
    throw_if_stopped(stop);
    const TrialView view = trial_view(target, trial, seed);
    const Pyramid pyramid = make_pyramid(view.gray, true);
    const FeatureSet features = find_features(pyramid, options.features);
    const auto seen = detect_target(target, features, pyramid, view.gray.size(), options);
    if (!seen) continue;
    double max_error = 0;
    const auto corners = target.corners();
    double side = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      const cv::Point2d truth = geometry::mapped(view.h, corners[i]);
      max_error = std::max(max_error, cv::norm(seen->corners[i] - truth));
      side += cv::norm(truth - geometry::mapped(view.h, corners[(i + 1) % 4])) / 4;
    }
    if (max_error < std::max(3.0, 0.05 * side)) ++found;
  }
  return static_cast<double>(found) / trials;
}

// Index of the part that contains `at`, when `length` px are divided into `n` equal parts.
int part_of(float at, int length, int n) {
  return std::clamp(static_cast<int>((static_cast<double>(at) + 0.5) * n / length), 0, n - 1);
}

cv::Mat count_cells(const Target& target) {
  const cv::Size cells = cells_of(target.size());
  cv::Mat count(cells, CV_32S, cv::Scalar(0));
  for (const TrainedFeature& f : target.features) {
    if (f.correct_matches < kMinCorrectTrials) continue;
    const int x = part_of(f.at.x, target.gray.cols, cells.width);
    const int y = part_of(f.at.y, target.gray.rows, cells.height);
    ++count.at<int>(y, x);
  }
  return count;
}

}  // namespace

Quality rate_target(const Target& target, int trials, std::uint64_t seed,
                    const std::stop_token& stop) {
  Quality q;
  std::vector<bool> is_occupied(48 * 48);
  int robust_features = 0;
  for (const TrainedFeature& f : target.features) {
    if (f.correct_matches < kMinCorrectTrials) continue;
    const int x = part_of(f.at.x, target.gray.cols, 48);
    const int y = part_of(f.at.y, target.gray.rows, 48);
    const auto k = static_cast<std::size_t>(y * 48 + x);
    if (!is_occupied[k]) ++robust_features;
    is_occupied[k] = true;
  }
  q.features = std::min(1.0, static_cast<double>(robust_features) / kGoodFeatureCount);
  const cv::Mat count = count_cells(target);
  q.spread = std::min(1.0, cv::countNonZero(count) / (0.8 * static_cast<double>(count.total())));
  const std::vector<bool> repeated = find_repeated(target);
  const auto repeated_count = std::count(repeated.begin(), repeated.end(), true);
  q.distinct = repeated.empty()
                   ? 0
                   : 1 - static_cast<double>(repeated_count) / static_cast<double>(repeated.size());
  q.repeatability = detection_rate(target, trials, seed, stop);
  q.rating = q.repeatability * std::sqrt(std::min({q.features, q.spread, q.distinct}));
  if (q.features < 0.5)
    q.reasons.push_back(
        fmt::format("few features: {} are robust to tilt, blur and noise, {} "
                    "are enough; choose an image with more detail and contrast",
                    robust_features, kGoodFeatureCount));
  if (q.spread < 0.6)
    q.reasons.push_back(
        fmt::format("clustered features: {:.0f} % of the image has none",
                    100 - 100.0 * cv::countNonZero(count) / static_cast<double>(count.total())));
  if (q.distinct < 0.5)
    q.reasons.push_back(fmt::format("repetitive: {:.0f} % of the features resemble another one",
                                    100 * (1 - q.distinct)));
  if (q.repeatability < 0.7)
    q.reasons.push_back(
        fmt::format("hard to detect: detected in {:.0f} % of the trials", 100 * q.repeatability));
  return q;
}

cv::Mat draw_quality(const Target& target) {
  const double zoom = std::clamp(900.0 / std::max(target.gray.cols, target.gray.rows), 1.0, 4.0);
  cv::Mat image;
  cv::cvtColor(target.gray, image, cv::COLOR_GRAY2BGR);
  cv::resize(image, image, cv::Size(), zoom, zoom, cv::INTER_LINEAR);
  const cv::Mat count = count_cells(target);
  const cv::Scalar red(60, 60, 230);
  const cv::Scalar green(90, 220, 90);
  for (int r = 0; r < count.rows; ++r)
    for (int c = 0; c < count.cols; ++c) {
      if (count.at<int>(r, c) > 0) continue;
      const int x0 = image.cols * c / count.cols;
      const int y0 = image.rows * r / count.rows;
      image::draw::fill_rounded(
          image,
          {x0, y0, image.cols * (c + 1) / count.cols - x0, image.rows * (r + 1) / count.rows - y0},
          0, red, 0.3);
    }
  const auto at = [&](const cv::Point2f& p) {
    return cv::Point2d((p.x + 0.5) * zoom - 0.5, (p.y + 0.5) * zoom - 0.5);
  };
  const std::size_t level = std::min<std::size_t>(2, target.anchors.size() - 1);
  for (const cv::Point2f& p : target.anchors[level])
    image::draw::cross(image, at(p), cv::Scalar(230, 200, 60), 4);
  const std::vector<bool> repeated = find_repeated(target);
  for (std::size_t i = 0; i < target.features.size(); ++i) {
    const TrainedFeature& f = target.features[i];
    if (f.correct_matches < kMinCorrectTrials) continue;
    image::draw::point(image, at(f.at), repeated[i] ? red : green, repeated[i] ? 2.5 : 2);
  }
  const Quality& q = target.quality;
  const int panel = 112 + 22 * static_cast<int>(q.reasons.size());
  cv::Mat out(image.rows + panel, std::max(image.cols, 640), CV_8UC3, cv::Scalar(30, 30, 30));
  image.copyTo(out(cv::Rect(0, 0, image.cols, image.rows)));
  image::draw::TextStyle style;
  style.height_px = 11;
  const auto bar = [&](int row, const char* name, double value) {
    image::draw::bar(out, {12, image.rows + 10 + 19 * row, 180, 12}, value,
                     value < 0.5 ? red : green, fmt::format("{} {:.2f}", name, value));
  };
  bar(0, "rating", q.rating);
  bar(1, "found in the trials", q.repeatability);
  bar(2, "features", q.features);
  bar(3, "spread", q.spread);
  bar(4, "distinct", q.distinct);
  int y = image.rows + 108;
  for (const std::string& reason : q.reasons) {
    image::draw::put_text(out, reason, {12, y}, style);
    y += 22;
  }
  return out;
}

}  // namespace tarsier::planar::image_targets
