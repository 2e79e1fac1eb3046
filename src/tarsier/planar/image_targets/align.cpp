// SPDX-License-Identifier: MIT
#include "tarsier/planar/image_targets/align.h"

#include "tarsier/geometry/planar_pose.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace tarsier::planar::image_targets {
namespace {

constexpr int kSide = 10;  // side of a patch, px
constexpr int kArea = kSide * kSide;
constexpr int kShifts = 4;  // iterations per patch

// The data of one patch while it is shifted.
struct Patch {
  float value[kArea];  // mean subtracted
  float dx[kArea];
  float dy[kArea];
  cv::Matx44f inverse;  // inverse of the products of (value, dx, dy, 1)
  double a, b, c;       // products of the gradients, divided by half their trace
};

// The linear part of h at p, px of the frame per px of the image.
cv::Matx22d jacobian_at(const cv::Matx33d& h, const cv::Point2d& p) {
  const double w = h(2, 0) * p.x + h(2, 1) * p.y + h(2, 2);
  const cv::Point2d q = geometry::mapped(h, p);
  return {(h(0, 0) - q.x * h(2, 0)) / w, (h(0, 1) - q.x * h(2, 1)) / w,
          (h(1, 0) - q.y * h(2, 0)) / w, (h(1, 1) - q.y * h(2, 1)) / w};
}

// Warps the target around `at` (px of its level) into a patch, with steps of `back` per px of the
// frame's level. `offset` is the position of the patch's centre relative to the warped point.
// Returns false if the patch leaves the level's margin or has too little contrast.
bool draw_patch(const Level& level, const cv::Point2d& at, const cv::Matx22d& back,
                const cv::Point2d& offset, Patch& patch) {
  constexpr int kDrawn = kSide + 2;
  float drawn[kDrawn][kDrawn];
  const double half = (kDrawn - 1) / 2.0;
  const double x0 = offset.x - half;
  const double y0 = offset.y - half;
  const double u0 = at.x + back(0, 0) * x0 + back(0, 1) * y0 + Level::kMargin;
  const double v0 = at.y + back(1, 0) * x0 + back(1, 1) * y0 + Level::kMargin;
  const double right = level.padded.cols - 2;
  const double bottom = level.padded.rows - 2;
  for (int corner = 0; corner < 4; ++corner) {
    const int c = (corner & 1) * (kDrawn - 1);
    const int r = (corner >> 1) * (kDrawn - 1);
    const double u = u0 + back(0, 0) * c + back(0, 1) * r;
    const double v = v0 + back(1, 0) * c + back(1, 1) * r;
    if (!(u >= 1 && v >= 1 && u < right && v < bottom)) return false;
  }
  const auto fixed = [](double v) { return static_cast<int>(std::lround(v * 65536)); };
  const int stride = static_cast<int>(level.padded.step);
  const auto* image = level.padded.ptr<std::uint8_t>();
  const int du = fixed(back(0, 0));
  const int dv = fixed(back(1, 0));
  for (int r = 0; r < kDrawn; ++r) {
    int u = fixed(u0 + back(0, 1) * r);
    int v = fixed(v0 + back(1, 1) * r);
    for (int c = 0; c < kDrawn; ++c) {
      const std::uint8_t* p = image + (v >> 16) * stride + (u >> 16);
      const int fu = (u >> 8) & 255;
      const int fv = (v >> 8) & 255;
      const int top = (p[0] << 8) + fu * (p[1] - p[0]);
      const int low = (p[stride] << 8) + fu * (p[stride + 1] - p[stride]);
      drawn[r][c] = static_cast<float>((top << 8) + fv * (low - top)) * (1.0F / 65536);
      u += du;
      v += dv;
    }
  }
  float mean = 0;
  for (int r = 0; r < kSide; ++r)
    for (int c = 0; c < kSide; ++c) {
      const int k = r * kSide + c;
      patch.value[k] = drawn[r + 1][c + 1];
      mean += patch.value[k];
      patch.dx[k] = 0.5F * (drawn[r + 1][c + 2] - drawn[r + 1][c]);
      patch.dy[k] = 0.5F * (drawn[r + 2][c + 1] - drawn[r][c + 1]);
    }
  mean /= kArea;
  float vv = 0;
  float vx = 0;
  float vy = 0;
  float xx = 0;
  float xy = 0;
  float yy = 0;
  float sx = 0;
  float sy = 0;
  for (int k = 0; k < kArea; ++k) {
    const float v = patch.value[k] -= mean;
    const float x = patch.dx[k];
    const float y = patch.dy[k];
    vv += v * v;
    vx += v * x;
    vy += v * y;
    xx += x * x;
    xy += x * y;
    yy += y * y;
    sx += x;
    sy += y;
  }
  if (vv < 4 * kArea || xx + yy < 1.0F * kArea) return false;  // flat
  const float ridge = 0.01F * (xx + yy);
  const cv::Matx44f m(vv, vx, vy, 0, vx, xx + ridge, xy, sx, vy, xy, yy + ridge, sy, 0, sx, sy,
                      kArea);
  bool ok = false;
  patch.inverse = m.inv(cv::DECOMP_CHOLESKY, &ok);
  const double trace = (xx + yy) / 2;
  patch.a = xx / trace;
  patch.b = xy / trace;
  patch.c = yy / trace;
  return ok;
}

struct PatchShift {
  double x = 0;
  double y = 0;
  double correlation = 0;
};

// Shifts the patch, whose top left pixel starts at (left, top) of the level, to its best match.
// Empty if it moves more than `max_shift` px or out of the level's margin.
std::optional<PatchShift> shift_patch(const Level& level, int left, int top, const Patch& patch,
                                      double max_shift) {
  PatchShift s;
  float seen[kArea];
  for (int iteration = 0;; ++iteration) {
    const double u = left + s.x + Level::kMargin;
    const double v = top + s.y + Level::kMargin;
    if (!(u >= 0 && v >= 0 && u + kSide + 1 < level.padded.cols &&
          v + kSide + 1 < level.padded.rows)) {
      return std::nullopt;
    }
    const auto iu = static_cast<int>(u);
    const auto iv = static_cast<int>(v);
    const auto fu = static_cast<float>(u - iu);
    const auto fv = static_cast<float>(v - iv);
    const float w00 = (1 - fu) * (1 - fv);
    const float w01 = fu * (1 - fv);
    const float w10 = (1 - fu) * fv;
    const float w11 = fu * fv;
    float jv = 0;
    float jx = 0;
    float jy = 0;
    float j1 = 0;
    float square = 0;
    for (int r = 0; r < kSide; ++r) {
      const std::uint8_t* p = level.padded.ptr<std::uint8_t>(iv + r) + iu;
      const std::uint8_t* q = level.padded.ptr<std::uint8_t>(iv + r + 1) + iu;
      for (int c = 0; c < kSide; ++c) {
        const float value = w00 * static_cast<float>(p[c]) + w01 * static_cast<float>(p[c + 1]) +
                            w10 * static_cast<float>(q[c]) + w11 * static_cast<float>(q[c + 1]);
        seen[r * kSide + c] = value;
      }
    }
    float vv = 0;
    for (int k = 0; k < kArea; ++k) {
      jv += seen[k] * patch.value[k];
      jx += seen[k] * patch.dx[k];
      jy += seen[k] * patch.dy[k];
      j1 += seen[k];
      square += seen[k] * seen[k];
      vv += patch.value[k] * patch.value[k];
    }
    if (iteration == kShifts) {
      const float spread = square - j1 * j1 / kArea;
      s.correlation = spread > 1 ? jv / std::sqrt(spread * vv) : 0;
      return s;
    }
    const cv::Vec4f fit = patch.inverse * cv::Vec4f(jv, jx, jy, j1);
    if (!(fit[0] > 0.05F)) return std::nullopt;
    // seen(x) = gain value(x + e): e is the error of the patch's position.
    const double ex = std::clamp(static_cast<double>(fit[1] / fit[0]), -1.5, 1.5);
    const double ey = std::clamp(static_cast<double>(fit[2] / fit[0]), -1.5, 1.5);
    s.x -= ex;
    s.y -= ey;
    if (!(s.x * s.x + s.y * s.y <= max_shift * max_shift)) return std::nullopt;
    if (ex * ex + ey * ey < 4e-4 && iteration + 2 < kShifts) iteration = kShifts - 2;
  }
}

// Number of full octaves of the frame down to which the target is at least this large.
int coarsest_level(const Pyramid& frame, double side, int min_side) {
  int level = 0;
  while (level + 2 < static_cast<int>(frame.levels.size()) &&
         side / frame.levels[static_cast<std::size_t>(level) + 2].step_x >= min_side) {
    level += 2;
  }
  return level;
}

cv::Matx33d to_level(const cv::Matx33d& h, const Level& level) {
  const cv::Matx33d shrink(1 / level.step_x, 0, 0.5 / level.step_x - 0.5, 0, 1 / level.step_y,
                           0.5 / level.step_y - 0.5, 0, 0, 1);
  return shrink * h;
}

double scale_at_center(const cv::Matx33d& h, cv::Size size) {
  return std::sqrt(
      std::abs(cv::determinant(jacobian_at(h, {size.width / 2.0, size.height / 2.0}))));
}

struct PatchMatch {
  Correspondence correspondence;  // px of the level
  double correlation;
};

// Shifts the first `max_anchors` anchors inside the frame.
std::vector<PatchMatch> match_anchors(const Target& target, const Level& level,
                                      const cv::Matx33d& h, std::size_t max_anchors, double reach,
                                      int& visible) {
  std::vector<PatchMatch> found;
  const double scale = scale_at_center(h, target.size());
  const auto& levels = target.pyramid.levels;
  const auto k = static_cast<std::size_t>(std::clamp<long>(
      std::lround(-2 * std::log2(std::max(scale, 1e-6))), 0, static_cast<long>(levels.size()) - 1));
  const Level& drawn = levels[k];
  visible = 0;
  Patch patch;
  for (const cv::Point2f& anchor : target.anchors[k]) {
    if (visible >= static_cast<int>(max_anchors)) break;
    const cv::Point2d p = geometry::mapped(h, anchor);
    if (!(p.x >= kSide / 2 && p.y >= kSide / 2 && p.x < level.width - kSide / 2 &&
          p.y < level.height - kSide / 2)) {
      continue;
    }
    const cv::Matx22d j = jacobian_at(h, anchor);
    const double det = j(0, 0) * j(1, 1) - j(0, 1) * j(1, 0);
    if (!(det > 1e-6)) continue;
    cv::Matx22d back(j(1, 1) / det, -j(0, 1) / det, -j(1, 0) / det, j(0, 0) / det);
    for (int c = 0; c < 2; ++c) {
      back(0, c) /= drawn.step_x;
      back(1, c) /= drawn.step_y;
    }
    // The patch lies on the level's own pixel grid, so the first iteration needs no interpolation.
    const int left = static_cast<int>(std::lround(p.x - (kSide - 1) / 2.0));
    const int top = static_cast<int>(std::lround(p.y - (kSide - 1) / 2.0));
    const cv::Point2d offset(left + (kSide - 1) / 2.0 - p.x, top + (kSide - 1) / 2.0 - p.y);
    ++visible;
    if (!draw_patch(drawn, drawn.from_image(anchor), back, offset, patch)) continue;
    const auto s = shift_patch(level, left, top, patch, reach);
    if (!s) continue;
    found.push_back(
        {{anchor, {p.x + s->x, p.y + s->y}, patch.a, patch.b, patch.c}, s->correlation});
  }
  return found;
}

double coverage_of(const std::vector<Correspondence>& correspondences, cv::Size size) {
  if (correspondences.size() < 3) return 0;
  std::vector<cv::Point2f> points;
  points.reserve(correspondences.size());
  for (const Correspondence& s : correspondences) points.emplace_back(s.at);
  std::vector<cv::Point2f> hull;
  cv::convexHull(points, hull);
  return cv::contourArea(hull) / (size.width * 1.0 * size.height);
}

// Shifts and fits several times on one level; refines the homography in `next`.
void align_on_level(const Target& target, const Level& level, const AlignOptions& options,
                    std::size_t patches, Alignment& next, LevelStats& report) {
  const cv::Size size = target.size();
  const cv::Matx33d grow(level.step_x, 0, 0.5 * level.step_x - 0.5, 0, level.step_y,
                         0.5 * level.step_y - 0.5, 0, 0, 1);
  for (int round = 0; round < options.rounds; ++round) {
    cv::Matx33d h = to_level(next.h, level);
    const double reach = round == 0 ? 5 : 3;
    const std::vector<PatchMatch> found =
        match_anchors(target, level, h, patches, reach, report.visible);
    std::vector<Correspondence> correspondences;
    for (const PatchMatch& f : found)
      if (f.correlation >= options.min_correlation) correspondences.push_back(f.correspondence);
    HomographyFitOptions fit;
    fit.tolerance_px = round == 0 ? 4 : 2;
    fit.sigma_px = 0.5;
    report.inliers = 0;
    next.correspondences.clear();
    if (!fit_homography(h, size, correspondences, fit)) continue;
    fit.tolerance_px = 1.5;
    static_cast<void>(fit_homography(h, size, correspondences, fit));
    double sum = 0;
    for (Correspondence s : correspondences) {
      const double e = error_of(h, s);
      if (e > 1.2) continue;
      ++report.inliers;
      sum += e * e;
      s.seen = level.to_image(s.seen);
      next.correspondences.push_back(s);
    }
    next.h = grow * h;
    next.h = next.h * (1 / next.h(2, 2));
    next.rms_px = report.inliers > 0 ? std::sqrt(sum / report.inliers) * level.step_x : 0;
  }
  report.coverage = coverage_of(next.correspondences, size);
}

}  // namespace

Alignment align(const Target& target, const Pyramid& frame, const cv::Matx33d& start,
                const AlignOptions& options) {
  options.check();
  Alignment out;
  out.h = start;
  const cv::Size size = target.size();
  const double side = scale_at_center(start, size) * std::sqrt(size.width * 1.0 * size.height);
  const int finest = 2 * options.finest_level;
  double part = 0;  // share of good patches on the previous level
  for (int k = std::max(finest, coarsest_level(frame, side, options.coarsest_side)); k >= finest;
       k -= 2) {
    Alignment next;
    next.h = out.h;
    LevelStats report;
    report.level = k;
    align_on_level(
        target, frame.levels[static_cast<std::size_t>(k)], options,
        static_cast<std::size_t>(k == finest ? options.fine_patches : options.coarse_patches), next,
        report);
    // If motion or defocus has removed the fine detail, the result of the coarser level is kept.
    const bool is_degraded = report.inliers < 4 || report.inliers < 0.3 * part * report.visible;
    if (!is_degraded || out.correspondences.empty()) {
      out.h = next.h;
      out.correspondences = std::move(next.correspondences);
      out.rms_px = next.rms_px;
      out.result_level = out.levels.size();
    }
    part = std::max(part, static_cast<double>(report.inliers) / std::max(1, report.visible));
    out.levels.push_back(report);
  }
  out.side_px = scale_at_center(out.h, size) * std::sqrt(size.width * 1.0 * size.height);
  out.deviation_px =
      out.correspondences.size() < 4
          ? std::numeric_limits<double>::infinity()
          : corner_deviation(out.h, size, out.correspondences, std::max(out.rms_px, 0.3));
  return out;
}

}  // namespace tarsier::planar::image_targets
