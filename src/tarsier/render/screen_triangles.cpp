// SPDX-License-Identifier: MIT
#include "tarsier/render/screen_triangles.h"

#include "tarsier/geometry/opencv_types.h"

#include <Eigen/Geometry>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace tarsier::render {
namespace {

constexpr double kGuardBand_px = 1024;      // px around the image; triangles are clipped there
constexpr double kMinInverseDepth = 1e-30;  // 1 / z below which a point counts as infinitely far
constexpr int kChunk = 4096;                // triangles that one thread prepares together

using Attributes = std::array<double, kAttributes>;

struct Corner {
  Eigen::Vector3d in_camera = Eigen::Vector3d::Zero();
  Attributes attributes{};
};

struct Projected {
  double x = 0;  // px
  double y = 0;
  double inverse = 0;       // 1 / z
  Attributes over_depth{};  // attributes / z
};

// A convex polygon: three corners, and one more for each of the five clipping planes.
template <typename Point>
struct Polygon {
  std::array<Point, 8> points;
  int count = 0;
  void add(const Point& point) { points[static_cast<std::size_t>(count++)] = point; }
  [[nodiscard]] const Point& operator[](int i) const { return points[static_cast<std::size_t>(i)]; }
};

Corner between(const Corner& a, const Corner& b, double t) {
  Corner c;
  c.in_camera = a.in_camera + t * (b.in_camera - a.in_camera);
  for (std::size_t k = 0; k < kAttributes; ++k) {
    c.attributes[k] = a.attributes[k] + t * (b.attributes[k] - a.attributes[k]);
  }
  return c;
}

Projected between(const Projected& a, const Projected& b, double t) {
  Projected c;
  c.x = a.x + t * (b.x - a.x);
  c.y = a.y + t * (b.y - a.y);
  c.inverse = a.inverse + t * (b.inverse - a.inverse);
  for (std::size_t k = 0; k < kAttributes; ++k) {
    c.over_depth[k] = a.over_depth[k] + t * (b.over_depth[k] - a.over_depth[k]);
  }
  return c;
}

// Sutherland and Hodgman 1974: clips to the part where `inside` (linear in the points) is >= 0.
template <typename Point, typename Inside>
void cut(Polygon<Point>& polygon, const Inside& inside) {
  Polygon<Point> clipped;
  for (int i = 0; i < polygon.count; ++i) {
    const Point& from = polygon[i];
    const Point& to = polygon[(i + 1) % polygon.count];
    const double a = inside(from);
    const double b = inside(to);
    if (a >= 0) clipped.add(from);
    if ((a >= 0) != (b >= 0)) {
      // Clipped in the same direction from both sides, so that neighbouring triangles get the same
      // point.
      clipped.add(a >= 0 ? between(from, to, a / (a - b)) : between(to, from, b / (b - a)));
    }
  }
  polygon = clipped;
}

double light_of(const Light& light, const Eigen::Vector3d& to_light,
                const Eigen::Vector3d& normal) {
  return light.ambient + light.diffuse * std::max(0.0, normal.dot(to_light));
}

double highlight_of(const Light& light, const Eigen::Vector3d& to_light,
                    const Eigen::Vector3d& normal, const Eigen::Vector3d& in_camera) {
  if (light.specular <= 0) return 0;
  const Eigen::Vector3d half = to_light - in_camera.normalized();
  const double length = half.norm();
  if (length <= 0) return 0;
  return light.specular * std::pow(std::max(0.0, normal.dot(half) / length), light.shininess);
}

// Data shared by all triangles.
struct TriangleSetup {
  const Item& item;
  const Scene& scene;
  const Projector& project;
  cv::Size image;
  Eigen::Vector3d to_light = Eigen::Vector3d::Zero();
  double step;   // px from sample to sample
  double first;  // px, of the first sample

  [[nodiscard]] Eigen::Vector3d in_camera(const cv::Vec3f& position) const {
    return item.camera_from_mesh * (geometry::to_eigen(position) * item.scale);
  }
  [[nodiscard]] bool corners_of(const Triangle& triangle, Polygon<Corner>& polygon) const;
  [[nodiscard]] Attributes shaded(const Corner& corner, const Eigen::Vector3d& normal) const;
  void add(const Triangle& triangle, std::vector<ScreenTriangle>& out) const;
  void finish(const Triangle& triangle, const Projected& a, const Projected& b, const Projected& c,
              std::vector<ScreenTriangle>& out) const;
  void set_surface(const Triangle& triangle, ScreenTriangle& screen) const;
};

Attributes TriangleSetup::shaded(const Corner& corner, const Eigen::Vector3d& normal) const {
  Attributes attributes{};
  if (scene.shading == Shading::kPhong) {
    for (std::size_t k = 0; k < 3; ++k) attributes[k] = normal[static_cast<int>(k)];
  } else {
    attributes[0] = light_of(scene.light, to_light, normal);
    attributes[1] = highlight_of(scene.light, to_light, normal, corner.in_camera);
  }
  return attributes;
}

bool TriangleSetup::corners_of(const Triangle& triangle, Polygon<Corner>& polygon) const {
  const Mesh& mesh = *item.mesh;
  std::array<Corner, 3> corners;
  for (std::size_t k = 0; k < 3; ++k) {
    corners[k].in_camera =
        in_camera(mesh.positions[static_cast<std::size_t>(triangle.position[k])]);
  }
  Eigen::Vector3d face = (corners[1].in_camera - corners[0].in_camera)
                             .cross(corners[2].in_camera - corners[0].in_camera);
  const double area = face.norm();
  if (!(area > 0) || !std::isfinite(area)) return false;
  const bool is_back_face = face.dot(corners[0].in_camera) > 0;
  if (is_back_face && !item.back_faces) return false;
  const double side = is_back_face ? -1 : 1;
  face *= side / area;
  for (std::size_t k = 0; k < 3; ++k) {
    Corner& corner = corners[k];
    if (item.role == Role::kSolid) {
      Eigen::Vector3d normal = face;
      if (triangle.normal[k] >= 0) {
        normal = item.camera_from_mesh.rotation *
                 geometry::to_eigen(mesh.normals[static_cast<std::size_t>(triangle.normal[k])]) *
                 side;
      }
      corner.attributes = shaded(corner, normal);
      if (triangle.uv[k] >= 0) {
        const cv::Vec2f& uv = mesh.uvs[static_cast<std::size_t>(triangle.uv[k])];
        corner.attributes[3] = uv[0];
        corner.attributes[4] = uv[1];
      }
    }
    polygon.add(corner);
  }
  return true;
}

void TriangleSetup::add(const Triangle& triangle, std::vector<ScreenTriangle>& out) const {
  Polygon<Corner> corners;
  if (!corners_of(triangle, corners)) return;
  cut(corners, [this](const Corner& c) { return c.in_camera[2] - scene.near; });
  if (corners.count < 3) return;
  Polygon<Projected> polygon;
  bool is_outside_guard_band = false;
  for (int i = 0; i < corners.count; ++i) {
    const cv::Point2d pixel = project(corners[i].in_camera);
    Projected p;
    p.x = pixel.x;
    p.y = pixel.y;
    p.inverse = 1 / corners[i].in_camera[2];
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || p.inverse < kMinInverseDepth) return;
    for (std::size_t k = 0; k < kAttributes; ++k) {
      p.over_depth[k] = corners[i].attributes[k] * p.inverse;
    }
    is_outside_guard_band = is_outside_guard_band || p.x < -kGuardBand_px || p.y < -kGuardBand_px ||
                            p.x > image.width + kGuardBand_px || p.y > image.height + kGuardBand_px;
    polygon.add(p);
  }
  if (is_outside_guard_band) {
    cut(polygon, [](const Projected& p) { return p.x + kGuardBand_px; });
    cut(polygon, [](const Projected& p) { return p.y + kGuardBand_px; });
    cut(polygon, [this](const Projected& p) { return image.width + kGuardBand_px - p.x; });
    cut(polygon, [this](const Projected& p) { return image.height + kGuardBand_px - p.y; });
  }
  for (int i = 2; i < polygon.count; ++i) {
    finish(triangle, polygon[0], polygon[i - 1], polygon[i], out);
  }
}

// Whether a sample lies between two grid positions.
bool holds_sample(int low, int high, double first, double step, int size) {
  const double l = std::max(static_cast<double>(low) / kGrid, -0.5);
  const double h = std::min(static_cast<double>(high) / kGrid, size - 0.5);
  return std::ceil((l - first) / step) <= std::floor((h - first) / step);
}

void TriangleSetup::finish(const Triangle& triangle, const Projected& a, const Projected& b,
                           const Projected& c, std::vector<ScreenTriangle>& out) const {
  ScreenTriangle screen;
  std::array<const Projected*, 3> p{&a, &b, &c};
  const auto snap = [](double v) { return static_cast<int>(std::lround(v * kGrid)); };
  for (std::size_t k = 0; k < 3; ++k) {
    screen.x[k] = snap(p[k]->x);
    screen.y[k] = snap(p[k]->y);
  }
  const auto [left, right] = std::minmax_element(screen.x.begin(), screen.x.end());
  const auto [top, bottom] = std::minmax_element(screen.y.begin(), screen.y.end());
  if (!holds_sample(*left, *right, first, step, image.width) ||
      !holds_sample(*top, *bottom, first, step, image.height)) {
    return;
  }
  const auto difference = [&](const std::array<int, 3>& v, std::size_t i) {
    return static_cast<double>(v[i] - v[0]) / kGrid;
  };
  const double area = difference(screen.x, 1) * difference(screen.y, 2) -
                      difference(screen.y, 1) * difference(screen.x, 2);
  if (area == 0) return;
  if (area < 0) {
    std::swap(screen.x[1], screen.x[2]);
    std::swap(screen.y[1], screen.y[2]);
    std::swap(p[1], p[2]);
  }
  const double x1 = difference(screen.x, 1);
  const double y1 = difference(screen.y, 1);
  const double x2 = difference(screen.x, 2);
  const double y2 = difference(screen.y, 2);
  const double inverse_area = 1 / std::abs(area);
  const auto slopes = [&](double v0, double v1, double v2) {
    return cv::Vec2d(((v1 - v0) * y2 - (v2 - v0) * y1) * inverse_area,
                     ((v2 - v0) * x1 - (v1 - v0) * x2) * inverse_area);
  };
  screen.origin_x = static_cast<double>(screen.x[0]) / kGrid;
  screen.origin_y = static_cast<double>(screen.y[0]) / kGrid;
  const cv::Vec2d inverse = slopes(p[0]->inverse, p[1]->inverse, p[2]->inverse);
  screen.inverse_depth = p[0]->inverse;
  screen.inverse_along_x = inverse[0];
  screen.inverse_along_y = inverse[1];
  for (std::size_t k = 0; k < kAttributes; ++k) {
    const cv::Vec2d slope = slopes(p[0]->over_depth[k], p[1]->over_depth[k], p[2]->over_depth[k]);
    screen.attributes[k] = {static_cast<float>(p[0]->over_depth[k]), static_cast<float>(slope[0]),
                            static_cast<float>(slope[1])};
  }
  set_surface(triangle, screen);
  out.push_back(screen);
}

void TriangleSetup::set_surface(const Triangle& triangle, ScreenTriangle& screen) const {
  const Mesh& mesh = *item.mesh;
  const Material plain;
  const Material& material =
      triangle.material < 0 ? plain : mesh.materials[static_cast<std::size_t>(triangle.material)];
  screen.color = material.color * 255.0F;
  if (material.texture < 0 || triangle.uv[0] < 0) return;
  screen.texture = &mesh.textures[static_cast<std::size_t>(material.texture)];
  // The level whose texels are about as large as the samples.
  std::array<cv::Point2d, 3> uv;
  std::array<cv::Point2d, 3> pixel;
  for (std::size_t k = 0; k < 3; ++k) {
    uv[k] = {mesh.uvs[static_cast<std::size_t>(triangle.uv[k])][0],
             mesh.uvs[static_cast<std::size_t>(triangle.uv[k])][1]};
    const Eigen::Vector3d x =
        in_camera(mesh.positions[static_cast<std::size_t>(triangle.position[k])]);
    if (x[2] < scene.near) return;  // clipped at the camera: the finest level is accurate enough
    pixel[k] = project(x);
  }
  const cv::Mat& finest = screen.texture->levels.front();
  const double texels = std::abs((uv[1] - uv[0]).cross(uv[2] - uv[0])) * finest.cols * finest.rows;
  const double samples = std::abs((pixel[1] - pixel[0]).cross(pixel[2] - pixel[0])) / (step * step);
  if (!(texels > samples)) return;
  const double level = samples > 0 ? std::round(0.5 * std::log2(texels / samples)) : 100;
  screen.level =
      static_cast<int>(std::min(level, static_cast<double>(screen.texture->levels.size() - 1)));
}

}  // namespace

Projector::Projector(const geometry::Camera& camera) : camera_(camera) {
  // A perspective is unlimited; a distorted camera is followed up to 87 degrees.
  largest_radius_ = camera.is_distorted() ? camera.largest_radius(20) * (1 - 1e-6)
                                          : std::numeric_limits<double>::infinity();
}

cv::Point2d Projector::operator()(const Eigen::Vector3d& in_camera) const {
  const cv::Point2d normalized(in_camera[0] / in_camera[2], in_camera[1] / in_camera[2]);
  const double radius = std::hypot(normalized.x, normalized.y);
  if (radius <= largest_radius_ || !camera_.is_distorted()) return camera_.pixel_of(normalized);
  const double beyond = radius / largest_radius_;
  const cv::Point2d center(camera_.cx, camera_.cy);
  return center + (camera_.pixel_of(normalized * (1 / beyond)) - center) * beyond;
}

std::vector<ScreenTriangle> screen_triangles(const Item& item, const Scene& scene,
                                             const Projector& project, const cv::Size& image) {
  const Eigen::Vector3d to_light = -scene.light.direction.normalized();
  const TriangleSetup setup{item,
                            scene,
                            project,
                            image,
                            to_light,
                            scene.antialias ? 0.5 : 1.0,
                            scene.antialias ? -0.25 : 0.0};
  const std::vector<Triangle>& triangles = item.mesh->triangles;
  const std::size_t chunks = (triangles.size() + kChunk - 1) / kChunk;
  std::vector<std::vector<ScreenTriangle>> parts(chunks);
  cv::parallel_for_(cv::Range(0, static_cast<int>(chunks)), [&](const cv::Range& range) {
    for (int chunk = range.start; chunk < range.end; ++chunk) {
      const std::size_t begin = static_cast<std::size_t>(chunk) * kChunk;
      const std::size_t end = std::min(begin + kChunk, triangles.size());
      for (std::size_t t = begin; t < end; ++t) {
        setup.add(triangles[t], parts[static_cast<std::size_t>(chunk)]);
      }
    }
  });
  std::vector<ScreenTriangle> all;
  for (const std::vector<ScreenTriangle>& part : parts) {
    all.insert(all.end(), part.begin(), part.end());
  }
  return all;
}

}  // namespace tarsier::render
