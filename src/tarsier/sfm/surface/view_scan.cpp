// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/view_scan.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/surface/dark_background.h"

#include <Eigen/Geometry>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace tarsier::sfm {
namespace {

constexpr double kBorder_px = 2;         // px
constexpr int kBackgroundMargin_px = 2;  // px of a depth map
constexpr float kMinScanCosine = 0.08F;  // 85 degrees
constexpr double kMaxPixels = 1.5e6;     // max size of the depth image for the visibility test
constexpr int kMaxFillSteps = 64;  // steps that spread colours to vertices that no image shows
constexpr float kFar = std::numeric_limits<float>::infinity();

// Transforms the vertices to a camera's frame.
std::vector<Eigen::Vector3f> in_camera(const SurfaceMesh& mesh, const geometry::Rigid3& pose) {
  std::vector<Eigen::Vector3f> result(mesh.vertices.size());
  cv::parallel_for_(cv::Range(0, static_cast<int>(result.size())), [&](const cv::Range& range) {
    for (int v = range.start; v < range.end; ++v)
      result[at(v)] = (pose * Eigen::Vector3d(mesh.vertices[at(v)].cast<double>())).cast<float>();
  });
  return result;
}

void draw_depth(const std::array<cv::Point2d, 3>& p, const std::array<double, 3>& inverse,
                cv::Mat1f& depth) {
  const double area = (p[1] - p[0]).cross(p[2] - p[0]);
  if (!(std::abs(area) > 1e-12)) return;
  const auto [left, right] = std::minmax({p[0].x, p[1].x, p[2].x});
  const auto [top, bottom] = std::minmax({p[0].y, p[1].y, p[2].y});
  const int x0 = std::max(0, static_cast<int>(std::ceil(std::clamp(left, -1.0, 1e6))));
  const int x1 =
      std::min(depth.cols - 1, static_cast<int>(std::floor(std::clamp(right, -1.0, 1e6))));
  const int y0 = std::max(0, static_cast<int>(std::ceil(std::clamp(top, -1.0, 1e6))));
  const int y1 =
      std::min(depth.rows - 1, static_cast<int>(std::floor(std::clamp(bottom, -1.0, 1e6))));
  for (int y = y0; y <= y1; ++y) {
    auto* row = depth.ptr<float>(y);
    for (int x = x0; x <= x1; ++x) {
      const cv::Point2d here(x, y);
      const double a = (p[1] - here).cross(p[2] - here) / area;
      const double b = (p[2] - here).cross(p[0] - here) / area;
      const double c = 1 - a - b;
      if (a < -1e-9 || b < -1e-9 || c < -1e-9) continue;
      const auto z = static_cast<float>(1 / (a * inverse[0] + b * inverse[1] + c * inverse[2]));
      row[x] = std::min(row[x], z);
    }
  }
}

cv::Mat1f draw_surface(const SurfaceMesh& mesh, const std::vector<Eigen::Vector3f>& points,
                       const geometry::Camera& camera) {
  cv::Mat1f depth(camera.height, camera.width, kFar);
  for (const Face& face : mesh.faces) {
    std::array<cv::Point2d, 3> p;
    std::array<double, 3> inverse{};
    bool is_in_front = true;
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3d x = points[at(face[k])].cast<double>();
      is_in_front = is_in_front && x[2] > 0;
      inverse[k] = 1 / x[2];
      p[k] = {camera.fx * x[0] * inverse[k] + camera.cx, camera.fy * x[1] * inverse[k] + camera.cy};
    }
    // Faces that reach behind the camera are skipped: they hardly hide the surface in front of it.
    if (is_in_front) draw_depth(p, inverse, depth);
  }
  return depth;
}

// A view with the depth of the surface.
struct DepthView {
  geometry::Camera camera;
  geometry::Camera small;  // camera of `depth`
  cv::Mat1f depth;
  cv::Mat1b background;  // including a margin; may be empty
  float tolerance = 0;

  [[nodiscard]] bool is_background(const cv::Point2d& p) const {
    if (background.empty()) return false;
    const auto u = static_cast<int>((p.x + 0.5) * background.cols / camera.width);
    const auto v = static_cast<int>((p.y + 0.5) * background.rows / camera.height);
    return background(std::clamp(v, 0, background.rows - 1),
                      std::clamp(u, 0, background.cols - 1)) != 0;
  }
  [[nodiscard]] cv::Point2d pixel(const Eigen::Vector3f& x) const {
    return {camera.fx * static_cast<double>(x[0] / x[2]) + camera.cx,
            camera.fy * static_cast<double>(x[1] / x[2]) + camera.cy};
  }
  [[nodiscard]] bool shows(const Eigen::Vector3f& x) const {
    if (!(x[2] > 0)) return false;
    const cv::Point2d p = pixel(x);
    if (!(p.x >= kBorder_px && p.y >= kBorder_px && p.x <= camera.width - 1 - kBorder_px &&
          p.y <= camera.height - 1 - kBorder_px) ||
        is_background(p))
      return false;
    const int u = static_cast<int>(small.fx * static_cast<double>(x[0] / x[2]) + small.cx + 0.5);
    const int v = static_cast<int>(small.fy * static_cast<double>(x[1] / x[2]) + small.cy + 0.5);
    const float nearest = depth(std::clamp(v, 0, depth.rows - 1), std::clamp(u, 0, depth.cols - 1));
    return x[2] <= nearest + tolerance;
  }
};

float cosine_of(const Eigen::Vector3f& normal, const Eigen::Vector3f& x) {
  const float length = normal.norm() * x.norm();
  return length > 0 ? -normal.dot(x) / length : 0;
}

float quality_of(const Face& face, const std::vector<Eigen::Vector3f>& points,
                 const DepthView& depth_view) {
  const Eigen::Vector3f& a = points[at(face[0])];
  const Eigen::Vector3f& b = points[at(face[1])];
  const Eigen::Vector3f& c = points[at(face[2])];
  const Eigen::Vector3f center = (a + b + c) / 3;
  const float cosine = cosine_of((b - a).cross(c - a), center);
  if (!(cosine > kMinScanCosine)) return 0;
  for (const Eigen::Vector3f& x : {a, b, c, center})
    if (!depth_view.shows(x)) return 0;
  const cv::Point2d p = depth_view.pixel(a);
  const double px = 0.5 * std::abs((depth_view.pixel(b) - p).cross(depth_view.pixel(c) - p));
  return static_cast<float>(px) * cosine;
}

void insert_ranked(FaceViews& best, FaceView candidate) {
  for (FaceView& slot : best) {
    if (candidate.quality > slot.quality) std::swap(candidate, slot);
    if (candidate.view < 0) return;
  }
}

// Spreads colours to neighbouring vertices until all have one.
void fill_colors(const SurfaceMesh& mesh, std::vector<cv::Vec3f>& colors,
                 std::vector<char>& known) {
  for (int step = 0; step < kMaxFillSteps; ++step) {
    std::vector<cv::Vec4f> sums(colors.size(), cv::Vec4f::all(0));
    bool found = false;
    for (const Face& face : mesh.faces) {
      for (const int to : face) {
        if (known[at(to)] != 0) continue;
        for (const int from : face) {
          if (known[at(from)] == 0) continue;
          const cv::Vec3f& color = colors[at(from)];
          sums[at(to)] += cv::Vec4f(color[0], color[1], color[2], 1);
          found = true;
        }
      }
    }
    if (!found) return;
    for (std::size_t v = 0; v < sums.size(); ++v) {
      if (!(sums[v][3] > 0)) continue;
      for (int k = 0; k < 3; ++k) colors[v][k] = sums[v][k] / sums[v][3];
      known[v] = 1;
    }
  }
}

}  // namespace

cv::Mat1f depth_of_surface(const SurfaceMesh& mesh, const geometry::Camera& camera,
                           const geometry::Rigid3& pose) {
  return draw_surface(mesh, in_camera(mesh, pose), camera);
}

cv::Vec3f color_at(const cv::Mat& bgr, const cv::Point2d& pixel) {
  const double x = std::clamp(pixel.x, 0.0, static_cast<double>(bgr.cols - 1));
  const double y = std::clamp(pixel.y, 0.0, static_cast<double>(bgr.rows - 1));
  const int x0 = std::min(static_cast<int>(x), std::max(0, bgr.cols - 2));
  const int y0 = std::min(static_cast<int>(y), std::max(0, bgr.rows - 2));
  const int x1 = std::min(x0 + 1, bgr.cols - 1);
  const int y1 = std::min(y0 + 1, bgr.rows - 1);
  const auto ax = static_cast<float>(x - x0);
  const auto ay = static_cast<float>(y - y0);
  const auto* upper = bgr.ptr<cv::Vec3b>(y0);
  const auto* lower = bgr.ptr<cv::Vec3b>(y1);
  return (cv::Vec3f(upper[x0]) * (1 - ax) + cv::Vec3f(upper[x1]) * ax) * (1 - ay) +
         (cv::Vec3f(lower[x0]) * (1 - ax) + cv::Vec3f(lower[x1]) * ax) * ay;
}

ViewScan scan_views(const Workspace& workspace, const SurfaceMesh& mesh, double tolerance,
                    int dark_level, Progress& progress, const std::stop_token& stop) {
  TARSIER_REQUIRE(tolerance > 0, "{}", tolerance);
  ViewScan scan;
  scan.faces.resize(mesh.faces.size());
  const std::vector<Eigen::Vector3f> normals = vertex_normals(mesh);
  std::vector<cv::Vec4f> sums(mesh.vertices.size(), cv::Vec4f::all(0));
  progress.begin("views", workspace.count(), "images");
  for (int view = 0; view < workspace.count(); ++view) {
    throw_if_stopped(stop);
    const std::vector<Eigen::Vector3f> points = in_camera(mesh, workspace.pose(view));
    DepthView depth_view;
    depth_view.camera = workspace.camera(view);
    const double pixels = static_cast<double>(depth_view.camera.width) * depth_view.camera.height;
    const double scale = std::min(1.0, std::sqrt(kMaxPixels / pixels));
    depth_view.small = camera_of_map(
        depth_view.camera,
        {std::max(1, static_cast<int>(std::lround(depth_view.camera.width * scale))),
         std::max(1, static_cast<int>(std::lround(depth_view.camera.height * scale)))});
    depth_view.depth = draw_surface(mesh, points, depth_view.small);
    depth_view.tolerance = static_cast<float>(tolerance);
    depth_view.background = dark_background(workspace, view, dark_level);
    if (!depth_view.background.empty())
      cv::dilate(depth_view.background, depth_view.background, cv::Mat(), {-1, -1},
                 kBackgroundMargin_px);
    cv::Mat image = workspace.read_image(view);
    cv::blur(image, image, {3, 3});
    cv::parallel_for_(cv::Range(0, static_cast<int>(mesh.faces.size())),
                      [&](const cv::Range& range) {
                        for (int f = range.start; f < range.end; ++f) {
                          const float quality = quality_of(mesh.faces[at(f)], points, depth_view);
                          if (quality > 0) insert_ranked(scan.faces[at(f)], {view, quality});
                        }
                      });
    const Eigen::Matrix3f rotation = workspace.pose(view).rotation.cast<float>();
    cv::parallel_for_(cv::Range(0, static_cast<int>(mesh.vertices.size())),
                      [&](const cv::Range& range) {
                        for (int v = range.start; v < range.end; ++v) {
                          const Eigen::Vector3f& x = points[at(v)];
                          const float cosine = cosine_of(rotation * normals[at(v)], x);
                          if (!(cosine > kMinScanCosine) || !depth_view.shows(x)) continue;
                          const float finer = static_cast<float>(depth_view.camera.fx) / x[2];
                          const float quality = cosine * finer * finer;
                          const cv::Vec3f color = color_at(image, depth_view.pixel(x));
                          const float weight = quality * quality;
                          sums[at(v)] += cv::Vec4f(color[0], color[1], color[2], 1) * weight;
                        }
                      });
    progress.advance();
  }
  progress.end();
  std::vector<cv::Vec3f> colors(sums.size(), cv::Vec3f::all(128));
  std::vector<char> known(sums.size(), 0);
  for (std::size_t v = 0; v < sums.size(); ++v) {
    if (!(sums[v][3] > 0)) {
      ++scan.unseen_vertices;
      continue;
    }
    for (int k = 0; k < 3; ++k) colors[v][k] = sums[v][k] / sums[v][3];
    known[v] = 1;
  }
  if (scan.unseen_vertices > 0) fill_colors(mesh, colors, known);
  for (const cv::Vec3f& color : colors) scan.colors.emplace_back(color);
  for (const FaceViews& views : scan.faces)
    if (views[0].view < 0) ++scan.unseen_faces;
  return scan;
}

}  // namespace tarsier::sfm
