// SPDX-License-Identifier: MIT
#include "tarsier/target/detect.h"

#include "tarsier/core/image.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>

namespace tarsier::target {

void DetectOptions::check() const {
  features.check();
  TARSIER_REQUIRE(match.candidates >= 2 && match.candidates <= 64, "candidates = {}: 2..64",
                  match.candidates);
  TARSIER_REQUIRE(tries >= 1 && tries <= 50, "tries = {}: 1..50", tries);
  TARSIER_REQUIRE(least_side_px >= 8 && least_side_px <= 10000, "least_side_px = {}: 8..10000",
                  least_side_px);
  TARSIER_REQUIRE(good_part >= 0 && good_part <= 1, "good_part = {}: 0..1", good_part);
  TARSIER_REQUIRE(good_patches >= 4 && good_patches <= 100, "good_patches = {}: 4..100",
                  good_patches);
  TARSIER_REQUIRE(least_covered >= 0 && least_covered <= 1, "least_covered = {}: 0..1",
                  least_covered);
  TARSIER_REQUIRE(most_deviation > 0, "most_deviation = {}: above 0", most_deviation);
}

bool is_convincing(const Alignment& alignment, const DetectOptions& options) {
  if (alignment.levels.empty()) return false;
  const LevelReport& last = alignment.levels[alignment.standing];
  if (last.good < 0.8 * options.good_patches ||
      last.good < 0.4 * options.good_part * last.visible ||
      alignment.deviation_px > std::max(1.5, options.most_deviation * alignment.side_px)) {
    return false;
  }
  return std::any_of(alignment.levels.begin(), alignment.levels.end(), [&](const LevelReport& l) {
    return l.good >= options.good_patches && l.good >= options.good_part * l.visible &&
           l.covered >= options.least_covered;
  });
}

std::optional<FoundTarget> detect_target(const Target& target, const FeatureSet& features,
                                         const Pyramid& pyramid, cv::Size frame,
                                         const DetectOptions& options) {
  const std::vector<Match> matches = match_features(features, target, options.match);
  const std::vector<Hypothesis> hypotheses =
      find_hypotheses(features, target, matches, static_cast<std::size_t>(options.tries));
  const double least_area = options.least_side_px * options.least_side_px;
  for (const Hypothesis& hypothesis : hypotheses) {
    if (!is_plausible(hypothesis.h, target.size(), frame, least_area)) continue;
    Alignment alignment = align(target, pyramid, hypothesis.h, {});
    if (!is_convincing(alignment, options) ||
        !is_plausible(alignment.h, target.size(), frame, least_area)) {
      continue;
    }
    FoundTarget found;
    found.homography = alignment.h;
    found.sightings = std::move(alignment.sightings);
    found.rms_px = alignment.rms_px;
    for (const LevelReport& l : alignment.levels)
      found.confidence =
          std::max(found.confidence, static_cast<double>(l.good) / std::max(1, l.visible));
    const auto corners = target.corners();
    for (std::size_t i = 0; i < 4; ++i)
      found.corners[i] = geometry::mapped(found.homography, corners[i]);
    return found;
  }
  return std::nullopt;
}

void find_poses(FoundTarget& found, const Target& target, const geometry::Camera& camera) {
  std::vector<cv::Point2d> plane;
  std::vector<cv::Point2d> pixels;
  for (const Sighting& s : found.sightings) {
    plane.push_back(target.on_plane(s.at));
    pixels.push_back(s.seen);
  }
  if (plane.size() < 6) {
    plane.clear();
    pixels.assign(found.corners.begin(), found.corners.end());
    for (const cv::Point2d& c : target.corners()) plane.push_back(target.on_plane(c));
  }
  found.poses = geometry::planar_poses(plane, pixels, camera);
}

std::vector<FoundTarget> detect_targets(const std::vector<Target>& targets, const cv::Mat& frame,
                                        const DetectOptions& options,
                                        const geometry::Camera* camera) {
  options.check();
  cv::Mat gray = frame;
  if (frame.type() == CV_8UC3) cv::cvtColor(frame, gray, cv::COLOR_BGR2GRAY);
  require_gray(gray);
  std::vector<FoundTarget> all;
  const Pyramid pyramid = make_pyramid(gray, true);
  const FeatureSet features = find_features(pyramid, options.features);
  for (std::size_t i = 0; i < targets.size(); ++i) {
    auto found = detect_target(targets[i], features, pyramid, gray.size(), options);
    if (!found) continue;
    found->target = i;
    if (camera != nullptr) find_poses(*found, targets[i], *camera);
    all.push_back(std::move(*found));
  }
  return all;
}

}  // namespace tarsier::target
