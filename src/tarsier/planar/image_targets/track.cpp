// SPDX-License-Identifier: MIT
#include "tarsier/planar/image_targets/track.h"

#include "tarsier/core/image.h"
#include "tarsier/media/gray_image.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::planar::image_targets {
namespace {

using Corners = std::array<cv::Point2d, 4>;

double side_of(const Corners& q) {
  double area = 0;
  for (std::size_t i = 0; i < 4; ++i) area += q[i].cross(q[(i + 1) % 4]) / 2;
  return std::sqrt(std::max(area, 0.0));
}

std::optional<cv::Matx33d> homography_to(const Target& target, const Corners& corners) {
  const auto from = target.corners();
  auto h = geometry::homography_of(from, corners);
  if (!h || !(std::abs((*h)(2, 2)) > 1e-12)) return std::nullopt;
  *h = *h * (1 / (*h)(2, 2));
  return h;
}

Corners corners_of(const Target& target, const cv::Matx33d& h) {
  Corners out;
  const auto from = target.corners();
  for (std::size_t i = 0; i < 4; ++i) out[i] = geometry::mapped(h, from[i]);
  return out;
}

// A sparse sampling of the target: grey values, and their positions under a predicted homography.
struct SparseTemplate {
  std::vector<float> value;
  std::vector<cv::Point> at;  // px of the level, with its margin
};

SparseTemplate make_sparse_template(const Target& target, const Level& level,
                                    const cv::Matx33d& h) {
  constexpr int kSide = 18;
  const double width = target.gray.cols;
  const double height = target.gray.rows;
  // The level of the target on which neighbours of the grid are about a pixel apart.
  const auto& levels = target.pyramid.levels;
  std::size_t k = 0;
  while (k + 1 < levels.size() && std::min(levels[k + 1].width, levels[k + 1].height) >= kSide) ++k;
  SparseTemplate sparse;
  for (int r = 0; r < kSide; ++r) {
    for (int c = 0; c < kSide; ++c) {
      const cv::Point2d p((c + 0.5) * width / kSide - 0.5, (r + 0.5) * height / kSide - 0.5);
      const cv::Point2d q = level.from_image(geometry::mapped(h, p));
      const cv::Point at(static_cast<int>(std::lround(q.x)), static_cast<int>(std::lround(q.y)));
      if (at.x < 0 || at.y < 0 || at.x >= level.width || at.y >= level.height) continue;
      const cv::Point2d t = levels[k].from_image(p);
      const int x = std::clamp(static_cast<int>(std::lround(t.x)), 0, levels[k].width - 1);
      const int y = std::clamp(static_cast<int>(std::lround(t.y)), 0, levels[k].height - 1);
      sparse.value.push_back(levels[k].row(y)[x]);
      sparse.at.push_back(at);
    }
  }
  return sparse;
}

// Correlation of the swarm's values with the level, shifted by (dx, dy); -1 if it leaves the level.
double correlation(const SparseTemplate& sparse, const Level& level, int dx, int dy) {
  float a = 0;
  float b = 0;
  float aa = 0;
  float bb = 0;
  float ab = 0;
  int n = 0;
  for (std::size_t i = 0; i < sparse.at.size(); ++i) {
    const int x = sparse.at[i].x + dx;
    const int y = sparse.at[i].y + dy;
    if (x < 0 || y < 0 || x >= level.width || y >= level.height) continue;
    const float u = sparse.value[i];
    const float v = level.row(y)[x];
    a += u;
    b += v;
    aa += u * u;
    bb += v * v;
    ab += u * v;
    ++n;
  }
  if (n < 40) return -1;
  const double va = aa - static_cast<double>(a) * a / n;
  const double vb = bb - static_cast<double>(b) * b / n;
  if (va < 1 || vb < 1) return -1;
  return (ab - static_cast<double>(a) * b / n) / std::sqrt(va * vb);
}

// The shift, px of the frame, within `reach_px` with the highest correlation.
cv::Point2d search_shift(const Target& target, const Pyramid& frame, const cv::Matx33d& h,
                         double side, double reach_px) {
  std::size_t k = 0;
  while (k + 2 < frame.levels.size() && side / frame.levels[k + 2].step_x >= 20) k += 2;
  const Level& level = frame.levels[k];
  const SparseTemplate sparse = make_sparse_template(target, level, h);
  const int reach = std::min(12, static_cast<int>(std::ceil(reach_px / level.step_x)));
  double best = correlation(sparse, level, 0, 0) + 0.02;  // bonus of the predicted position
  cv::Point shift;
  for (int dy = -reach; dy <= reach; ++dy) {
    for (int dx = -reach; dx <= reach; ++dx) {
      const double c = correlation(sparse, level, dx, dy);
      if (c > best) {
        best = c;
        shift = {dx, dy};
      }
    }
  }
  return {shift.x * level.step_x, shift.y * level.step_y};
}

bool is_still_tracked(const Alignment& alignment, const TrackOptions& options) {
  DetectOptions test = options.detect;
  test.min_inlier_share = options.min_inlier_share;
  test.min_inlier_patches = options.min_inlier_patches;
  test.min_coverage *= 0.5;
  return is_convincing(alignment, test);
}

std::optional<Alignment> track_target(const Target& target, const TrackOptions& options,
                                      const TrackState::TargetTrack& last, const Pyramid& pyramid,
                                      cv::Size frame) {
  const double min_area = options.detect.min_side_px * options.detect.min_side_px;
  Corners predicted = last.corners;
  for (std::size_t i = 0; i < 4; ++i) predicted[i] += last.velocity[i];
  for (int attempt = 0; attempt < 2; ++attempt) {
    auto h = homography_to(target, attempt == 0 ? predicted : last.corners);
    if (!h || !is_plausible(*h, target.size(), frame, min_area)) continue;
    const double side = side_of(last.corners);
    const cv::Point2d shift =
        search_shift(target, pyramid, *h, side, options.search_px * (attempt + 1));
    const cv::Matx33d start = cv::Matx33d(1, 0, shift.x, 0, 1, shift.y, 0, 0, 1) * *h;
    Alignment alignment = align(target, pyramid, start, options.align);
    if (is_still_tracked(alignment, options) &&
        is_plausible(alignment.h, target.size(), frame, min_area)) {
      return alignment;
    }
  }
  return std::nullopt;
}

// Low-pass filter whose strength falls with the motion: a measurement far from the smoothed
// position is used unchanged, small jitter has little effect.
void steady(const Corners& seen, double scale_px, Corners& smooth) {
  double max_squared = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const cv::Point2d d = seen[i] - smooth[i];
    max_squared = std::max(max_squared, d.dot(d));
  }
  const double part = std::max(0.08, max_squared / (max_squared + scale_px * scale_px));
  for (std::size_t i = 0; i < 4; ++i) smooth[i] += part * (seen[i] - smooth[i]);
}

// Estimates the pose from nine points of the print under the homography. They are as accurate as
// all sightings, and as smooth as the homography.
void update_pose(const Target& target, const geometry::Camera& camera, const cv::Matx33d& h,
                 TrackState::TargetTrack& one, TrackedTarget& out) {
  std::vector<cv::Point2d> plane;
  std::vector<cv::Point2d> pixels;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) {
      const cv::Point2d p(c * target.gray.cols / 2.0 - 0.5, r * target.gray.rows / 2.0 - 0.5);
      plane.push_back(target.on_plane(p));
      pixels.push_back(geometry::mapped(h, p));
    }
  const auto poses = geometry::planar_poses(plane, pixels, camera);
  if (!poses) {
    one.pose.reset();
    return;
  }
  out.pose = poses->best;
  if (one.pose && poses->other && poses->ambiguity_ratio() < 3) {
    // If both poses fit nearly equally, selects the one that continues the last frame.
    const auto turn = [&](const geometry::PlanarPose& p) {
      return geometry::angle_of(p.camera_from_plane.rotation * one.pose->rotation.transpose());
    };
    if (turn(*poses->other) < 0.5 * turn(poses->best)) out.pose = *poses->other;
  }
  one.pose = out.pose->camera_from_plane;
}

TrackedTarget report(const Target& target, const TrackOptions& options,
                     const geometry::Camera* camera, const cv::Matx33d& h, bool detected,
                     TrackState::TargetTrack& one) {
  const Corners corners = corners_of(target, h);
  if (detected || !one.is_tracked) {
    one = TrackState::TargetTrack{};
    one.steady = corners;
  } else {
    for (std::size_t i = 0; i < 4; ++i) one.velocity[i] = corners[i] - one.corners[i];
  }
  one.is_tracked = true;
  one.corners = corners;
  ++one.frames;
  TrackedTarget out;
  out.detected = detected;
  out.frames = one.frames;
  out.corners = corners;
  out.homography = h;
  if (options.steady_px > 0) {
    steady(corners, options.steady_px, one.steady);
    if (const auto smooth = homography_to(target, one.steady)) {
      out.homography = *smooth;
      out.corners = one.steady;
    }
  }
  if (camera != nullptr) update_pose(target, *camera, out.homography, one, out);
  return out;
}

double inlier_share(const Alignment& alignment) {
  double best = 0;
  for (const LevelStats& l : alignment.levels)
    best = std::max(best, static_cast<double>(l.inliers) / std::max(1, l.visible));
  return best;
}

}  // namespace

void TrackOptions::check() const {
  check_fields(*this);
  detect.check();
  align.check();
}

std::vector<TrackedTarget> track(const std::vector<Target>& targets, const TrackOptions& options,
                                 TrackState& state, const cv::Mat& frame,
                                 const geometry::Camera* camera, DebugSink* debug) {
  options.check();
  const cv::Mat gray = gray_of(frame);
  if (state.size != gray.size() || state.targets.size() != targets.size()) {
    state = TrackState{};
    state.size = gray.size();
    state.targets.resize(targets.size());
  }
  const std::int64_t number = state.frame++;
  std::vector<std::optional<TrackedTarget>> found(targets.size());
  Pyramid pyramid;
  bool any = false;
  bool just_lost = false;
  for (std::size_t i = 0; i < targets.size(); ++i) {
    TrackState::TargetTrack& one = state.targets[i];
    if (!one.is_tracked) continue;
    if (pyramid.levels.empty()) pyramid = make_pyramid(gray, false, 30);
    const auto alignment = track_target(targets[i], options, one, pyramid, gray.size());
    if (!alignment) {
      one.is_tracked = false;
      just_lost = true;
      continue;
    }
    found[i] = report(targets[i], options, camera, alignment->h, false, one);
    found[i]->rms_px = alignment->rms_px;
    found[i]->confidence = inlier_share(*alignment);
    any = true;
  }
  const bool missing =
      std::any_of(found.begin(), found.end(), [](const auto& f) { return !f.has_value(); });
  if (missing && (!any || just_lost || number % options.detect_every == 0)) {
    const Pyramid full = make_pyramid(gray, true);
    const FeatureSet features = find_features(full, options.detect.features);
    if (debug != nullptr) show_features(*debug, gray, features);
    for (std::size_t i = 0; i < targets.size(); ++i) {
      if (found[i]) continue;
      const auto seen =
          detect_target(targets[i], features, full, gray.size(), options.detect, debug);
      if (!seen) continue;
      found[i] = report(targets[i], options, camera, seen->homography, true, state.targets[i]);
      found[i]->rms_px = seen->rms_px;
      found[i]->confidence = seen->confidence;
    }
  }
  std::vector<TrackedTarget> out;
  for (std::size_t i = 0; i < targets.size(); ++i) {
    if (!found[i]) continue;
    found[i]->target = i;
    out.push_back(*found[i]);
  }
  return out;
}

}  // namespace tarsier::planar::image_targets
