// SPDX-License-Identifier: MIT
#include "tarsier/synth/boards.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/planar/markers/dictionary.h"
#include "tarsier/synth/noise.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace tarsier::synth {
namespace {

using planar::calibration::BoardKind;
using planar::calibration::BoardSpec;

constexpr int kSamples = 8;  // per pixel, in each direction

bool holds(const cv::Rect2d& box, const cv::Point2d& p) {
  return p.x >= box.x && p.y >= box.y && p.x < box.x + box.width && p.y < box.y + box.height;
}

// The rays through the corners of all pixels; NaN if there is none.
cv::Mat rays_of(const geometry::Camera& camera) {
  cv::Mat rays(camera.height + 1, camera.width + 1, CV_64FC2);
  cv::parallel_for_(cv::Range(0, rays.rows), [&](const cv::Range& range) {
    for (int y = range.start; y < range.end; ++y) {
      auto* row = rays.ptr<cv::Vec2d>(y);
      for (int x = 0; x < rays.cols; ++x) {
        constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
        const auto ray = camera.normalized_of({x - 0.5, y - 0.5});
        row[x] = ray ? cv::Vec2d(ray->x, ray->y) : cv::Vec2d(kNone, kNone);
      }
    }
  });
  return rays;
}

// Intersections of the rays with the sheet; NaN if there is none.
cv::Mat sheet_map(const cv::Mat& rays, const geometry::Rigid3& camera_from_board) {
  const Eigen::Matrix3d back = camera_from_board.rotation.transpose();
  const Eigen::Vector3d center = camera_from_board.center();
  cv::Mat map(rays.size(), CV_64FC2);
  cv::parallel_for_(cv::Range(0, map.rows), [&](const cv::Range& range) {
    for (int y = range.start; y < range.end; ++y) {
      const auto* ray = rays.ptr<cv::Vec2d>(y);
      auto* row = map.ptr<cv::Vec2d>(y);
      for (int x = 0; x < map.cols; ++x) {
        constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
        row[x] = {kNone, kNone};
        const Eigen::Vector3d direction = back * Eigen::Vector3d(ray[x][0], ray[x][1], 1);
        const double along = -center[2] / direction[2];
        if (!(along > 0) || !std::isfinite(along)) continue;
        row[x] = {center[0] + along * direction[0], center[1] + along * direction[1]};
      }
    }
  });
  return map;
}

cv::Mat background(cv::Size size, const BoardAppearance& appearance) {
  cv::Mat gray(size, CV_32FC1, cv::Scalar(0.45 * (appearance.paper + appearance.ink)));
  Rng rng(appearance.seed ^ 0x5eedb0a2dULL);
  const double larger = std::max(size.width, size.height);
  for (int i = 0; i < appearance.clutter; ++i) {
    const int y = rng.integer(0, size.height - 1);
    const cv::Point at(rng.integer(0, size.width - 1), y);
    const int radius = std::max(2, cvRound(larger * rng.uniform(0.01, 0.1)));
    const cv::Scalar level(rng.uniform(appearance.ink, appearance.paper));
    if (i % 2 == 0) {
      cv::circle(gray, at, radius, level, cv::FILLED, cv::LINE_AA);
    } else {
      cv::rectangle(gray, cv::Rect(at.x, at.y, radius, cvRound(radius * rng.uniform(0.4, 2.0))),
                    level, cv::FILLED);
    }
  }
  return gray;
}

}  // namespace

BoardPrint::BoardPrint(const BoardSpec& spec) : spec_(spec) {
  spec.check();
  const double p = spec.pitch;
  const cv::Point2d last = spec.point(spec.points() - 1);
  double right = last.x;
  for (int i = 0; i < spec.points(); ++i) right = std::max(right, spec.point(i).x);
  print_ = cv::Rect2d(-p, -p, right + 2 * p, last.y + 2 * p);
  sheet_ = cv::Rect2d(-2 * p, -2 * p, right + 4 * p, last.y + 4 * p);
  if (spec.kind != BoardKind::kCharuco) return;
  const planar::markers::Dictionary& family = planar::markers::find_dictionary(spec.family);
  const int n = family.cells();
  for (std::size_t id = 0; id < planar::calibration::marker_squares(spec).size(); ++id) {
    const planar::markers::Code code = family.code(static_cast<int>(id));
    cv::Mat cells = cv::Mat::zeros(n + 2, n + 2, CV_8UC1);
    for (int k = 0; k < n * n; ++k)
      cells.at<uchar>(1 + k / n, 1 + k % n) = (code >> (n * n - 1 - k) & 1U) != 0 ? 1 : 0;
    markers_.push_back(cells);
  }
}

bool BoardPrint::is_sheet(const cv::Point2d& at) const { return holds(sheet_, at); }

bool BoardPrint::is_ink(const cv::Point2d& at) const {
  const double p = spec_.pitch;
  if (spec_.kind == BoardKind::kCircles || spec_.kind == BoardKind::kCirclesGrid) {
    const int row = std::clamp(cvRound(at.y / p), 0, spec_.rows - 1);
    for (int r = std::max(0, row - 1); r <= std::min(spec_.rows - 1, row + 1); ++r) {
      const double step = spec_.kind == BoardKind::kCircles ? 2 * p : p;
      const double shift = spec_.kind == BoardKind::kCircles ? (r % 2) * p : 0;
      const int column = std::clamp(cvRound((at.x - shift) / step), 0, spec_.columns - 1);
      if (std::hypot(at.x - shift - column * step, at.y - r * p) <= 0.5 * spec_.ratio * p)
        return true;
    }
    return false;
  }
  if (!holds(print_, at)) return false;
  const double u = at.x / p + 1;  // squares
  const double v = at.y / p + 1;
  const int column = cvFloor(u);
  const int row = cvFloor(v);
  if ((column + row) % 2 == 0) return true;
  if (spec_.kind == BoardKind::kChess) return false;
  const auto id = static_cast<std::size_t>((row * spec_.columns + column) / 2);
  if (id >= markers_.size()) return false;
  const cv::Mat& cells = markers_[id];
  const double rim = 0.5 * (1 - spec_.ratio);
  const int x = cvFloor((u - column - rim) / spec_.ratio * cells.cols);
  const int y = cvFloor((v - row - rim) / spec_.ratio * cells.rows);
  return x >= 0 && y >= 0 && x < cells.cols && y < cells.rows && cells.at<uchar>(y, x) == 0;
}

std::optional<bool> BoardPrint::uniform_ink(const cv::Rect2d& box) const {
  const double p = spec_.pitch;
  const cv::Point2d low = box.tl();
  const cv::Point2d high = box.br();
  if (spec_.kind == BoardKind::kCircles || spec_.kind == BoardKind::kCirclesGrid) {
    const double reach = 0.5 * std::hypot(box.width, box.height) + 1e-9 * p;
    if (!(reach < 0.25 * p)) return std::nullopt;
    const cv::Point2d at = 0.5 * (low + high);
    const bool is_staggered = spec_.kind == BoardKind::kCircles;
    const double step = is_staggered ? 2 * p : p;
    const double radius = 0.5 * spec_.ratio * p;
    const int row = std::clamp(cvRound(at.y / p), 0, spec_.rows - 1);
    for (int r = std::max(0, row - 1); r <= std::min(spec_.rows - 1, row + 1); ++r) {
      const double x = at.x - (is_staggered ? (r % 2) * p : 0);
      const int column = std::clamp(cvRound(x / step), 0, spec_.columns - 1);
      for (int c = std::max(0, column - 1); c <= std::min(spec_.columns - 1, column + 1); ++c) {
        const double distance = std::hypot(x - c * step, at.y - r * p);
        if (distance + reach < radius) return true;
        if (distance < radius + reach) return std::nullopt;
      }
    }
    return false;
  }
  if (high.x < print_.x || low.x > print_.br().x || high.y < print_.y || low.y > print_.br().y)
    return false;
  if (!holds(print_, low) || !holds(print_, high)) return std::nullopt;
  const cv::Vec4d squares(low.x / p + 1, low.y / p + 1, high.x / p + 1, high.y / p + 1);
  const int column = cvFloor(squares[0]);
  const int row = cvFloor(squares[1]);
  if (cvFloor(squares[2]) != column || cvFloor(squares[3]) != row) return std::nullopt;
  if (spec_.kind == BoardKind::kChess || (column + row) % 2 == 0) return is_ink(low);
  const auto id = static_cast<std::size_t>((row * spec_.columns + column) / 2);
  if (id >= markers_.size()) return false;
  const double rim = 0.5 * (1 - spec_.ratio);
  const auto cell = [&](double square, int first) {
    return cvFloor((square - first - rim) / spec_.ratio * markers_[id].cols);
  };
  if (cell(squares[0], column) != cell(squares[2], column) ||
      cell(squares[1], row) != cell(squares[3], row)) {
    return std::nullopt;
  }
  return is_ink(low);
}

BoardRenderer::BoardRenderer(const geometry::Camera& camera, const BoardSpec& spec)
    : camera_(camera), print_(spec) {
  camera.check();
  rays_ = rays_of(camera);
}

cv::Mat render_board(const geometry::Camera& camera, const geometry::Rigid3& camera_from_board,
                     const BoardSpec& spec, const BoardAppearance& appearance) {
  return BoardRenderer(camera, spec).render(camera_from_board, appearance);
}

cv::Mat BoardRenderer::render(const geometry::Rigid3& camera_from_board,
                              const BoardAppearance& appearance) const {
  TARSIER_REQUIRE(appearance.blur_px >= 0 && appearance.blur_px <= 50, "blur {} px",
                  appearance.blur_px);
  const cv::Mat map = sheet_map(rays_, camera_from_board);
  cv::Mat gray = background({camera_.width, camera_.height}, appearance);
  const double width = print_.sheet().width;
  cv::parallel_for_(cv::Range(0, camera_.height), [&](const cv::Range& range) {
    for (int y = range.start; y < range.end; ++y) {
      const auto* above = map.ptr<cv::Vec2d>(y);
      const auto* below = map.ptr<cv::Vec2d>(y + 1);
      auto* out = gray.ptr<float>(y);
      for (int x = 0; x < camera_.width; ++x) {
        // The distortion is nearly linear within a pixel, so its corners are interpolated.
        const std::array<cv::Vec2d, 4> corner{above[x], above[x + 1], below[x], below[x + 1]};
        bool is_on = true;
        for (const cv::Vec2d& c : corner) {
          is_on = is_on && holds({print_.sheet().x - width, print_.sheet().y - width, 3 * width,
                                  2 * width + 2 * print_.sheet().height},
                                 {c[0], c[1]});
        }
        if (!is_on) continue;
        // Most pixels see nothing of the sheet, or only paper or only ink.
        const auto [left_x, right_x] =
            std::minmax({corner[0][0], corner[1][0], corner[2][0], corner[3][0]});
        const auto [top_y, bottom_y] =
            std::minmax({corner[0][1], corner[1][1], corner[2][1], corner[3][1]});
        const cv::Rect2d box(left_x, top_y, right_x - left_x, bottom_y - top_y);
        const cv::Rect2d sheet = print_.sheet();
        if (left_x > sheet.br().x || right_x < sheet.x || top_y > sheet.br().y ||
            bottom_y < sheet.y) {
          continue;
        }
        if (print_.is_sheet(box.tl()) && print_.is_sheet(box.br())) {
          if (const auto ink = print_.uniform_ink(box)) {
            const double middle =
                0.25 * (corner[0][0] + corner[1][0] + corner[2][0] + corner[3][0]);
            const double light = 1 - appearance.fall_off * (middle - print_.sheet().x) / width;
            out[x] = static_cast<float>(light * (*ink ? appearance.ink : appearance.paper));
            continue;
          }
        }
        double sum = 0;
        for (int sy = 0; sy < kSamples; ++sy) {
          const double b = (sy + 0.5) / kSamples;
          const cv::Vec2d left = corner[0] + b * (corner[2] - corner[0]);
          const cv::Vec2d right = corner[1] + b * (corner[3] - corner[1]);
          for (int sx = 0; sx < kSamples; ++sx) {
            const cv::Vec2d p = left + (sx + 0.5) / kSamples * (right - left);
            const cv::Point2d at(p[0], p[1]);
            if (!print_.is_sheet(at)) {
              sum += static_cast<double>(out[x]);
              continue;
            }
            const double light =
                1 - appearance.fall_off * std::clamp((at.x - print_.sheet().x) / width, 0.0, 1.0);
            sum += light * (print_.is_ink(at) ? appearance.ink : appearance.paper);
          }
        }
        out[x] = static_cast<float>(sum / (kSamples * kSamples));
      }
    }
  });
  if (appearance.blur_px > 0)
    cv::GaussianBlur(gray, gray, {}, appearance.blur_px, appearance.blur_px);
  cv::Mat image;
  gray.convertTo(image, CV_8U);
  if (appearance.color) cv::cvtColor(image, image, cv::COLOR_GRAY2BGR);
  if (appearance.noise > 0) add_noise(image, appearance.noise, appearance.seed);
  return image;
}

planar::calibration::BoardView exact_view(const geometry::Camera& camera,
                                          const geometry::Rigid3& camera_from_board,
                                          const BoardSpec& spec, double margin_px) {
  planar::calibration::BoardView view;
  for (int i = 0; i < spec.points(); ++i) {
    const cv::Point2d p = spec.point(i);
    const auto pixel = camera.project(camera_from_board * Eigen::Vector3d(p.x, p.y, 0));
    if (!pixel) continue;
    const bool inside = pixel->x >= margin_px && pixel->y >= margin_px &&
                        pixel->x <= camera.width - 1 - margin_px &&
                        pixel->y <= camera.height - 1 - margin_px;
    if (!inside) continue;
    view.points.push_back(i);
    view.pixels.emplace_back(*pixel);
  }
  return view;
}

geometry::Rigid3 board_pose(const geometry::Camera& camera, const BoardSpec& spec,
                            const cv::Point2d& at, const Eigen::Vector3d& angles_deg,
                            double share) {
  const BoardPrint print(spec);
  const cv::Rect2d sheet = print.sheet();
  const auto turn = [](int axis, double degrees) {
    return geometry::rotation_by(degrees * CV_PI / 180 * Eigen::Vector3d::Unit(axis));
  };
  const auto ray = camera.normalized_of({at.x * (camera.width - 1), at.y * (camera.height - 1)});
  TARSIER_REQUIRE(ray.has_value(), "no ray through ({}, {})", at.x, at.y);
  // Along the central ray; a fisheye changes the scale there, too.
  const double smaller = std::min(camera.width, camera.height);
  const double distance =
      0.5 * (camera.fx + camera.fy) * std::max(sheet.width, sheet.height) / (share * smaller);
  geometry::Rigid3 pose;
  pose.rotation = turn(2, angles_deg[2]) * turn(1, angles_deg[0]) * turn(0, angles_deg[1]);
  const Eigen::Vector3d center(sheet.x + 0.5 * sheet.width, sheet.y + 0.5 * sheet.height, 0);
  const Eigen::Vector3d direction = Eigen::Vector3d(ray->x, ray->y, 1).normalized();
  pose.translation = distance * direction - pose.rotation * center;
  return pose;
}

std::vector<geometry::Rigid3> board_poses(const geometry::Camera& camera, const BoardSpec& spec,
                                          int count, std::uint64_t seed) {
  Rng rng(seed);
  // Dots must be entirely visible.
  const bool is_dots = spec.kind == BoardKind::kCircles || spec.kind == BoardKind::kCirclesGrid;
  const double margin = is_dots ? std::max(6.0, 0.035 * std::max(camera.width, camera.height)) : 6;
  std::vector<geometry::Rigid3> poses;
  for (int tries = 0; static_cast<int>(poses.size()) < count; ++tries) {
    TARSIER_REQUIRE(tries < 2000 * (count + 1), "the camera sees no whole board");
    const double side = 15 + 25 * rng.uniform();
    const double tip = 15 + 25 * rng.uniform();
    const int k = static_cast<int>(poses.size()) % 5;
    const double turn = rng.uniform(-20, 20);
    const double b = k == 2 ? tip : k == 3 ? -tip : rng.uniform(-12, 12);
    const double a = k == 0 ? side : k == 1 ? -side : rng.uniform(-12, 12);
    const double fill = rng.uniform(0.6, 1.1);
    const cv::Point2d at{rng.uniform(0.15, 0.85), rng.uniform(0.15, 0.85)};
    const geometry::Rigid3 pose = board_pose(camera, spec, at, {a, b, turn}, fill);
    if (static_cast<int>(exact_view(camera, pose, spec, margin).points.size()) == spec.points())
      poses.push_back(pose);
  }
  return poses;
}

namespace {

constexpr double kStill_s = 0.6;   // duration at one position
constexpr double kMove_s = 0.6;    // duration of a move
constexpr double kAbsent_s = 0.5;  // without the board, at the beginning
constexpr int kPositionCount = 20;

geometry::Camera video_camera(cv::Size size) {
  TARSIER_REQUIRE(size.width >= 160 && size.height >= 120, "{}x{} px", size.width, size.height);
  geometry::Camera camera;
  camera.width = size.width;
  camera.height = size.height;
  camera.fx = camera.fy = 0.85 * size.width;
  camera.cx = 0.51 * size.width;
  camera.cy = 0.49 * size.height;
  camera.distortion = {-0.25, 0.08, 5e-4, -5e-4, 0};
  return camera;
}

geometry::Rigid3 between(const geometry::Rigid3& a, const geometry::Rigid3& b, double share) {
  return {geometry::interpolate(a.rotation, b.rotation, share),
          (1 - share) * a.translation + share * b.translation};
}

}  // namespace

BoardVideo::BoardVideo(cv::Size size, const BoardSpec& spec, std::uint64_t seed)
    : camera_(video_camera(size)),
      spec_(spec),
      poses_(board_poses(camera_, spec, kPositionCount, seed)),
      renderer_(camera_, spec),
      seed_(seed) {}

std::optional<geometry::Rigid3> BoardVideo::pose_at(double time_s) const {
  const double round = kAbsent_s + kPositionCount * (kStill_s + kMove_s);
  const double time = std::fmod(std::max(0.0, time_s), round) - kAbsent_s;
  if (time < 0) return std::nullopt;
  const auto index = std::min<std::size_t>(kPositionCount - 1,
                                           static_cast<std::size_t>(time / (kStill_s + kMove_s)));
  const double progress =
      (time - static_cast<double>(index) * (kStill_s + kMove_s) - kStill_s) / kMove_s;
  if (progress <= 0) return poses_[index];
  const double eased = progress * progress * (3 - 2 * progress);
  return between(poses_[index], poses_[(index + 1) % kPositionCount], eased);
}

cv::Mat BoardVideo::image_at(double time_s) const {
  BoardAppearance appearance;
  appearance.seed = seed_;
  appearance.noise = 0;
  appearance.clutter = 12;
  geometry::Rigid3 absent;  // far behind the camera
  absent.translation = {0, 0, -100};
  return renderer_.render(pose_at(time_s).value_or(absent), appearance);
}

}  // namespace tarsier::synth
