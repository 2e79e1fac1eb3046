// SPDX-License-Identifier: MIT
#include "render.h"

#include "tarsier/core/require.h"
#include "tarsier/geometry/opencv_types.h"

#include "framing.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

namespace tarsier::sfm {
namespace {

constexpr double kTanUpright = 0.364;  // tangent of half the angle of view: 40 degrees in all
constexpr float kNoDepth = std::numeric_limits<float>::infinity();
constexpr double kNearShare = 0.02;   // share of the distance; nearer points are not drawn
constexpr float kMaxHaze = 0.3F;      // share of the background in the farthest points
constexpr float kMaxShade = 0.4F;     // darkening of points closely behind others
constexpr double kLinePx = 1.3;       // width
constexpr double kHiddenLine = 0.22;  // opacity of lines behind points
constexpr int kMaxSplat_px = 96;      // px, max size of a splat

double radians(double degrees) { return degrees * std::numbers::pi / 180; }

struct Dot {
  cv::Vec3f position;  // in the frame of the cloud
  cv::Vec3b color;
};

// Everything that stays the same while the cloud rotates.
struct Scene {
  Framing framing;
  std::vector<Dot> dots;
  std::vector<Pyramid> pyramids;
};

Scene scene_of(const Model& model, const ViewOptions& options) {
  Scene scene;
  scene.framing = frame_model(model, options.cameras);
  scene.dots.reserve(model.points.size());
  for (const Point& point : model.points) {
    const Eigen::Vector3d framed = scene.framing.framed(point.position);
    if (framed.allFinite()) scene.dots.push_back({cv::Vec3f(geometry::to_cv(framed)), point.color});
  }
  if (options.cameras) scene.pyramids = camera_pyramids(model, scene.framing);
  return scene;
}

Viewpoint viewpoint_of(const Framing& framing, const ViewOptions& options) {
  Viewpoint view;
  view.camera.width = options.size.width;
  view.camera.height = options.size.height;
  // In images higher than wide, the horizontal angle is kept instead.
  view.camera.fx = view.camera.fy =
      0.5 * std::min(options.size.height, options.size.width) / kTanUpright;
  view.camera.cx = 0.5 * (options.size.width - 1);
  view.camera.cy = 0.5 * (options.size.height - 1);
  // A full turn must give bit-identical images.
  const double yaw = radians(std::remainder(options.yaw_deg, 360));
  const double pitch = radians(options.pitch_deg);
  view.distance = options.distance > 0
                      ? options.distance
                      : fitting_distance(framing.radius, framing.half_height, pitch,
                                         0.5 * options.size.width / view.camera.fx,
                                         0.5 * options.size.height / view.camera.fy);
  const double s = std::sin(yaw);
  const double c = std::cos(yaw);
  const double st = std::sin(pitch);
  const double ct = std::cos(pitch);
  // Rows: right, down and forward in the frame of the cloud.
  const Eigen::Matrix3d turn{{c, 0, -s}, {st * s, -ct, st * c}, {-ct * s, -st, -ct * c}};
  view.pose.rotation = turn * framing.base;
  view.pose.translation =
      -(view.pose.rotation * framing.center) + Eigen::Vector3d(0, 0, view.distance);
  return view;
}

// Begin and end of each row of a round splat; small splats are square.
using Spans = std::vector<std::vector<std::array<int, 2>>>;

const Spans& spans() {
  static const Spans all = [] {
    Spans result(kMaxSplat_px + 1);
    for (int size = 1; size <= kMaxSplat_px; ++size) {
      for (int y = 0; y < size; ++y) {
        std::array<int, 2> span{0, size};
        if (size > 3) {
          const double dy = y + 0.5 - 0.5 * size;
          const double half = std::sqrt(0.25 * size * size - dy * dy);
          span = {static_cast<int>(std::lround(0.5 * size - half)),
                  static_cast<int>(std::lround(0.5 * size + half))};
        }
        result[static_cast<std::size_t>(size)].push_back(span);
      }
    }
    return result;
  }();
  return all;
}

cv::Vec3b mix(const cv::Vec3b& a, const cv::Vec3b& b, float share_of_b) {
  cv::Vec3b result;
  for (int k = 0; k < 3; ++k)
    result[k] = cv::saturate_cast<std::uint8_t>(
        static_cast<float>(a[k]) +
        share_of_b * (static_cast<float>(b[k]) - static_cast<float>(a[k])));
  return result;
}

void draw_dots(const Scene& scene, const Viewpoint& view, const ViewOptions& options,
               cv::Mat& image, cv::Mat1f& depth) {
  // Assumes that about a third of the image shows the cloud.
  const double spacing =
      std::sqrt(0.35 * options.size.area() /
                static_cast<double>(std::max<std::size_t>(1, scene.dots.size())));
  const double unit = options.size.height / 720.0;
  const double px = options.point_px > 0
                        ? options.point_px
                        : std::clamp(1.25 * spacing, std::max(1.0, 2 * unit), 2 + 5 * unit);
  const cv::Matx33f turn(
      geometry::to_cv(Eigen::Matrix3d(view.pose.rotation * scene.framing.base.transpose())));
  const auto distance = static_cast<float>(view.distance);
  const auto near_z = static_cast<float>(kNearShare * view.distance);
  const auto focal = static_cast<float>(view.camera.fx);
  const auto cx = static_cast<float>(view.camera.cx);
  const auto cy = static_cast<float>(view.camera.cy);
  const auto scale = static_cast<float>(scene.framing.cloud);
  const float max_side = std::min<float>(kMaxSplat_px, 3 * static_cast<float>(px));
  const Spans& rows = spans();
  for (const Dot& dot : scene.dots) {
    const cv::Vec3f& p = dot.position;
    const float z = turn(2, 0) * p[0] + turn(2, 1) * p[1] + turn(2, 2) * p[2] + distance;
    if (!(z > near_z)) continue;
    const float u = cx + focal * (turn(0, 0) * p[0] + turn(0, 1) * p[1] + turn(0, 2) * p[2]) / z;
    const float v = cy + focal * (turn(1, 0) * p[0] + turn(1, 1) * p[1] + turn(1, 2) * p[2]) / z;
    const float side = std::clamp(static_cast<float>(px) * distance / z, 1.0F, max_side);
    if (!(u > -side && v > -side && u < static_cast<float>(image.cols) + side &&
          v < static_cast<float>(image.rows) + side))
      continue;
    const int size = static_cast<int>(side + 0.5F);
    const float half = 0.5F * static_cast<float>(size - 1);
    const int left = static_cast<int>(std::floor(u - half + 0.5F));
    const int top = static_cast<int>(std::floor(v - half + 0.5F));
    const float depth_share = std::clamp((z - distance + scale) / (2 * scale), 0.0F, 1.0F);
    const cv::Vec3b color = mix(dot.color, options.background, kMaxHaze * depth_share);
    const auto& span = rows[static_cast<std::size_t>(size)];
    for (int y = std::max(0, -top); y < std::min(size, image.rows - top); ++y) {
      const auto [begin, end] = span[static_cast<std::size_t>(y)];
      auto* pixels = image.ptr<cv::Vec3b>(top + y);
      auto* depths = depth.ptr<float>(top + y);
      for (int x = std::max(left + begin, 0); x < std::min(left + end, image.cols); ++x) {
        if (z < depths[x]) {
          depths[x] = z;
          pixels[x] = color;
        }
      }
    }
  }
}

// Darkens points closely behind others, which emphasises edges and solidity.
void shade_edges(const cv::Mat1f& depth, float scale, cv::Mat& image) {
  const float per_unit = 1 / (0.08F * scale);
  for (int y = 1; y + 1 < image.rows; ++y) {
    const auto* above = depth.ptr<float>(y - 1);
    const auto* here = depth.ptr<float>(y);
    const auto* below = depth.ptr<float>(y + 1);
    auto* pixels = image.ptr<cv::Vec3b>(y);
    for (int x = 1; x + 1 < image.cols; ++x) {
      const float z = here[x];
      if (z == kNoDepth) continue;
      const auto behind = [&](float other) {
        return std::clamp((z - other) * per_unit, 0.0F, 1.0F);
      };
      const float sum =
          behind(above[x]) + behind(below[x]) + behind(here[x - 1]) + behind(here[x + 1]);
      if (sum > 0) pixels[x] = mix(pixels[x], cv::Vec3b(0, 0, 0), kMaxShade * 0.25F * sum);
    }
  }
}

// Draws an anti-aliased line between two points in front of the camera, with a depth test per
// pixel.
void draw_line(const Viewpoint& view, Eigen::Vector3d a, Eigen::Vector3d b, const cv::Vec3b& color,
               const cv::Mat1f& depth, cv::Mat& image) {
  const double near_z = kNearShare * view.distance;
  if (!(a[2] > near_z) && !(b[2] > near_z)) return;
  if (a[2] < near_z) a += (b - a) * ((near_z - a[2]) / (b[2] - a[2]));
  if (b[2] < near_z) b += (a - b) * ((near_z - b[2]) / (a[2] - b[2]));
  const auto pixel = [&](const Eigen::Vector3d& p) {
    return cv::Point2d(view.camera.cx + view.camera.fx * p[0] / p[2],
                       view.camera.cy + view.camera.fy * p[1] / p[2]);
  };
  cv::Point2d from = pixel(a);
  cv::Point2d to = pixel(b);
  double from_inverse = 1 / a[2];
  double to_inverse = 1 / b[2];
  // Steps along the longer of x and y.
  const bool steep = std::abs(to.y - from.y) > std::abs(to.x - from.x);
  if (steep) {
    std::swap(from.x, from.y);
    std::swap(to.x, to.y);
  }
  if (from.x > to.x) {
    std::swap(from, to);
    std::swap(from_inverse, to_inverse);
  }
  const int along = steep ? image.rows : image.cols;
  const int across = steep ? image.cols : image.rows;
  const double run = to.x - from.x;
  const double slope = run > 1e-9 ? (to.y - from.y) / run : 0;
  const double normal_scale = 1 / std::hypot(1.0, slope);
  const double reach = (0.5 * kLinePx + 0.5) / normal_scale;
  const int first = static_cast<int>(std::clamp(std::ceil(from.x - 0.5), 0.0, double(along)));
  const int last = static_cast<int>(std::clamp(std::floor(to.x + 0.5), -1.0, double(along - 1)));
  for (int i = first; i <= last; ++i) {
    const double t = run > 1e-9 ? std::clamp((i - from.x) / run, 0.0, 1.0) : 0.5;
    const double center = from.y + t * (to.y - from.y);
    if (center < -reach || center > across + reach) continue;
    const double z = 1 / (from_inverse + t * (to_inverse - from_inverse));
    const int low = std::max(0, static_cast<int>(std::ceil(center - reach)));
    const int high = std::min(across - 1, static_cast<int>(std::floor(center + reach)));
    for (int j = low; j <= high; ++j) {
      const cv::Point at = steep ? cv::Point(j, i) : cv::Point(i, j);
      double share =
          std::clamp(0.5 * kLinePx + 0.5 - std::abs(j - center) * normal_scale, 0.0, 1.0);
      if (z > static_cast<double>(depth(at))) share *= kHiddenLine;
      auto& target = image.at<cv::Vec3b>(at);
      target = mix(target, color, static_cast<float>(share));
    }
  }
}

void draw(const Scene& scene, const ViewOptions& options, cv::Mat& image, cv::Mat1f& depth) {
  const Viewpoint view = viewpoint_of(scene.framing, options);
  image.create(options.size, CV_8UC3);
  image.setTo(options.background);
  depth.create(options.size);
  depth.setTo(kNoDepth);
  draw_dots(scene, view, options, image, depth);
  shade_edges(depth, static_cast<float>(scene.framing.cloud), image);
  const cv::Vec3b& background = options.background;
  const bool light = background[0] + 4 * background[1] + 2 * background[2] > 7 * 110;
  const cv::Vec3b color = light ? cv::Vec3b(26, 84, 180) : cv::Vec3b(96, 160, 240);
  for (const Pyramid& pyramid : scene.pyramids) {
    for (const auto& [from, to] : kPyramidEdges)
      draw_line(view, view.pose * pyramid.vertices[static_cast<std::size_t>(from)],
                view.pose * pyramid.vertices[static_cast<std::size_t>(to)], color, depth, image);
  }
}

}  // namespace

void ViewOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(std::isfinite(yaw_deg), "{}", yaw_deg);
}

Viewpoint viewpoint_of(const Model& model, const ViewOptions& options) {
  options.check();
  return viewpoint_of(frame_model(model, options.cameras), options);
}

cv::Mat render_model(const Model& model, const ViewOptions& options) {
  options.check();
  cv::Mat image;
  cv::Mat1f depth;
  draw(scene_of(model, options), options, image, depth);
  return image;
}

void render_turntable(const Model& model, const ViewOptions& options, int frames,
                      const std::function<void(int, const cv::Mat&)>& take) {
  options.check();
  TARSIER_REQUIRE(frames >= 1, "{}", frames);
  TARSIER_REQUIRE(take != nullptr, "no function that receives the images");
  const Scene scene = scene_of(model, options);
  cv::Mat image;
  cv::Mat1f depth;
  for (int i = 0; i < frames; ++i) {
    ViewOptions turned = options;
    turned.yaw_deg += 360.0 * i / frames;
    draw(scene, turned, image, depth);
    take(i, image);
  }
}

}  // namespace tarsier::sfm
