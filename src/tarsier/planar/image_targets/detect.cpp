// SPDX-License-Identifier: MIT
#include "tarsier/planar/image_targets/detect.h"

#include "tarsier/core/image.h"
#include "tarsier/media/gray_image.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>

namespace tarsier::planar::image_targets {
namespace {

const cv::Scalar kGood(80, 190, 60);
const cv::Scalar kBad(60, 60, 220);

// Draws the frame with the target's image on its right, and lines between matches: green if they
// agree with the detected position.
void show_matches(DebugSink& debug, const Target& target, const FeatureSet& features,
                  const std::vector<Match>& matches, const cv::Mat& frame,
                  const std::optional<DetectedTarget>& found) {
  constexpr double kFits = 4;  // px of the frame
  cv::Mat shown(std::max(frame.rows, target.gray.rows), frame.cols + target.gray.cols, CV_8UC1,
                cv::Scalar(255));
  frame.copyTo(shown(cv::Rect({0, 0}, frame.size())));
  target.gray.copyTo(shown(cv::Rect({frame.cols, 0}, target.gray.size())));
  cv::cvtColor(shown, shown, cv::COLOR_GRAY2BGR);
  for (const bool good : {false, true}) {
    for (const Match& match : matches) {
      const cv::Point2d seen(features.features[static_cast<std::size_t>(match.feature)].at);
      const cv::Point2d at(target.features[static_cast<std::size_t>(match.trained)].at);
      const bool fits = found && cv::norm(geometry::mapped(found->homography, at) - seen) < kFits;
      if (fits != good) continue;
      cv::line(shown, seen, at + cv::Point2d(frame.cols, 0), good ? kGood : kBad, 1, cv::LINE_AA);
    }
  }
  debug.image(fmt::format("matches of {}", target.name), shown);
}

// Draws the aligned patches at their positions in the frame.
void show_correspondences(DebugSink& debug, const Target& target, const cv::Mat& frame,
                          const DetectedTarget& found) {
  cv::Mat shown;
  cv::cvtColor(frame, shown, cv::COLOR_GRAY2BGR);
  for (std::size_t i = 0; i < 4; ++i)
    cv::line(shown, found.corners[i], found.corners[(i + 1) % 4], kGood, 1, cv::LINE_AA);
  for (const Correspondence& correspondence : found.correspondences)
    cv::circle(shown, correspondence.seen, 3, kGood, 1, cv::LINE_AA);
  debug.image(fmt::format("patches of {}", target.name), shown);
}

}  // namespace

void DetectOptions::check() const {
  check_fields(*this);
  features.check();
  match.check();
}

bool is_convincing(const Alignment& alignment, const DetectOptions& options) {
  if (alignment.levels.empty()) return false;
  const LevelStats& last = alignment.levels[alignment.result_level];
  if (last.inliers < 0.8 * options.min_inlier_patches ||
      last.inliers < 0.4 * options.min_inlier_share * last.visible ||
      alignment.deviation_px > std::max(1.5, options.max_deviation * alignment.side_px)) {
    return false;
  }
  return std::any_of(alignment.levels.begin(), alignment.levels.end(), [&](const LevelStats& l) {
    return l.inliers >= options.min_inlier_patches &&
           l.inliers >= options.min_inlier_share * l.visible && l.coverage >= options.min_coverage;
  });
}

std::optional<DetectedTarget> detect_target(const Target& target, const FeatureSet& features,
                                            const Pyramid& pyramid, cv::Size frame,
                                            const DetectOptions& options, DebugSink* debug) {
  const std::vector<Match> matches = match_features(features, target, options.match);
  const std::vector<Hypothesis> hypotheses =
      find_hypotheses(features, target, matches, static_cast<std::size_t>(options.max_hypotheses));
  const double min_area = options.min_side_px * options.min_side_px;
  std::optional<DetectedTarget> answer;
  for (const Hypothesis& hypothesis : hypotheses) {
    if (!is_plausible(hypothesis.h, target.size(), frame, min_area)) continue;
    Alignment alignment = align(target, pyramid, hypothesis.h, {});
    if (!is_convincing(alignment, options) ||
        !is_plausible(alignment.h, target.size(), frame, min_area)) {
      continue;
    }
    DetectedTarget found;
    found.homography = alignment.h;
    found.correspondences = std::move(alignment.correspondences);
    found.rms_px = alignment.rms_px;
    for (const LevelStats& l : alignment.levels)
      found.confidence =
          std::max(found.confidence, static_cast<double>(l.inliers) / std::max(1, l.visible));
    const auto corners = target.corners();
    for (std::size_t i = 0; i < 4; ++i)
      found.corners[i] = geometry::mapped(found.homography, corners[i]);
    answer = std::move(found);
    break;
  }
  if (debug != nullptr) {
    const cv::Mat gray = pyramid.levels.front().inner();
    show_matches(*debug, target, features, matches, gray, answer);
    if (answer) show_correspondences(*debug, target, gray, *answer);
  }
  return answer;
}

void show_features(DebugSink& debug, const cv::Mat& gray, const FeatureSet& features) {
  cv::Mat shown;
  cv::cvtColor(gray, shown, cv::COLOR_GRAY2BGR);
  for (const Feature& feature : features.features)
    cv::circle(shown, feature.at, std::max(2, cvRound(3 * feature.scale)), {0, 200, 255}, 1,
               cv::LINE_AA);
  debug.image("features", shown);
}

void find_poses(DetectedTarget& found, const Target& target, const geometry::Camera& camera) {
  std::vector<cv::Point2d> plane;
  std::vector<cv::Point2d> pixels;
  for (const Correspondence& s : found.correspondences) {
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

std::vector<DetectedTarget> detect_targets(const std::vector<Target>& targets, const cv::Mat& frame,
                                           const DetectOptions& options,
                                           const geometry::Camera* camera, DebugSink* debug) {
  options.check();
  const cv::Mat gray = gray_of(frame);
  std::vector<DetectedTarget> all;
  const Pyramid pyramid = make_pyramid(gray, true);
  const FeatureSet features = find_features(pyramid, options.features);
  if (debug != nullptr) show_features(*debug, gray, features);
  for (std::size_t i = 0; i < targets.size(); ++i) {
    auto found = detect_target(targets[i], features, pyramid, gray.size(), options, debug);
    if (!found) continue;
    found->target = i;
    if (camera != nullptr) find_poses(*found, targets[i], *camera);
    all.push_back(std::move(*found));
  }
  return all;
}

}  // namespace tarsier::planar::image_targets
