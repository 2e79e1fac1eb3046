// SPDX-License-Identifier: MIT
#include "tarsier/synth/face/synth_face.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tarsier::synth {

namespace {

constexpr int kRings = 28;     // of the skull, from top to bottom
constexpr int kSegments = 40;  // around it
constexpr double kGap = 2;     // mm between the skull and the face in front of it
constexpr double kSkin = 0.93;

struct Ellipsoid {
  cv::Vec3d center;
  cv::Vec3d radius;
};

// A skull for the face: as wide as the face, behind it everywhere, higher than its brows.
Ellipsoid skull_of(const Eigen::Matrix3Xd& shape) {
  const Eigen::Vector3d low = shape.rowwise().minCoeff();
  const Eigen::Vector3d high = shape.rowwise().maxCoeff();
  const double width = high.x() - low.x();
  const double height = high.y() - low.y();
  Ellipsoid skull;
  skull.radius = {0.52 * width, 0.72 * height, 0};
  skull.center = {(low.x() + high.x()) / 2, low.y() + 0.16 * height, high.z()};
  // The largest depth for which every point of the face lies in front of the skull.
  double depth = 1.3 * width;
  for (Eigen::Index i = 0; i < shape.cols(); ++i) {
    const double u = (shape(0, i) - skull.center[0]) / skull.radius[0];
    const double v = (shape(1, i) - skull.center[1]) / skull.radius[1];
    const double rest = 1 - u * u - v * v;
    if (rest < 0.25) continue;
    depth = std::min(depth, (skull.center[2] - shape(2, i) - kGap) / std::sqrt(rest));
  }
  skull.radius[2] = std::max(depth, 0.3 * width);
  return skull;
}

cv::Vec3f float_of(const cv::Vec3d& v) {
  return {static_cast<float>(v[0]), static_cast<float>(v[1]), static_cast<float>(v[2])};
}

// A closed surface of rings; the outside is on the left of rising segments.
void add_rings(render::Mesh& mesh, int rings, int segments, const auto& point, const auto& material,
               const auto& uv) {
  const int first = static_cast<int>(mesh.positions.size());
  for (int r = 0; r <= rings; ++r) {
    for (int s = 0; s < segments; ++s) {
      const cv::Vec3d p = point(r, s);
      mesh.positions.push_back(float_of(p));
      mesh.uvs.push_back(uv(p));
    }
  }
  const auto index = [&](int r, int s) { return first + r * segments + s % segments; };
  for (int r = 0; r < rings; ++r) {
    for (int s = 0; s < segments; ++s) {
      for (const auto& corners :
           {std::array{index(r, s), index(r, s + 1), index(r + 1, s)},
            std::array{index(r, s + 1), index(r + 1, s + 1), index(r + 1, s)}}) {
        render::Triangle triangle;
        triangle.position = corners;
        triangle.uv = corners;
        cv::Vec3f middle(0, 0, 0);
        for (const int c : corners) middle += mesh.positions[static_cast<std::size_t>(c)] / 3;
        triangle.material = material(middle);
        mesh.triangles.push_back(triangle);
      }
    }
  }
}

}  // namespace

render::Mesh FaceSynth::mesh(const FacePerson& person) const {
  Eigen::VectorXd b = Eigen::VectorXd::Zero(head_.mode_count());
  const Eigen::Index given = std::min(b.size(), person.b.size());
  b.head(given) = person.b.head(given);
  const Eigen::Matrix3Xd shape = face::head::shape_of(head_, b);
  const cv::Mat wide = texture(person);

  render::Mesh mesh;
  mesh.textures.push_back(render::make_texture(wide));
  mesh.materials.push_back({"skin", {1, 1, 1}, 0});
  mesh.materials.push_back(
      {"plain skin",
       {static_cast<float>(kSkin), static_cast<float>(kSkin), static_cast<float>(kSkin)},
       0});
  const cv::Vec3f hair(static_cast<float>(person.hair[0]), static_cast<float>(person.hair[1]),
                       static_cast<float>(person.hair[2]));
  mesh.materials.push_back({"hair", hair / 255.0F, -1});
  const auto uv_of = [&](double x, double y) {
    return cv::Vec2f(static_cast<float>((x + 0.5) / wide.cols),
                     static_cast<float>(1 - (y + 0.5) / wide.rows));
  };
  for (Eigen::Index i = 0; i < shape.cols(); ++i) {
    mesh.positions.push_back(float_of({shape(0, i), shape(1, i), shape(2, i)}));
    mesh.uvs.push_back(uv_of(points_at_(0, i), points_at_(1, i)));
  }
  for (const face::shape::Triangle& corners : appearance_.mesh) {
    render::Triangle triangle;
    // Counter-clockwise from the front, where y points down.
    triangle.position = {corners[0], corners[2], corners[1]};
    triangle.uv = triangle.position;
    triangle.material = 0;
    mesh.triangles.push_back(triangle);
  }

  const Ellipsoid skull = skull_of(shape);
  const double brow = shape.row(1).minCoeff();
  const double height = shape.row(1).maxCoeff() - brow;
  const double hair_line = brow - 0.28 * height;
  // In the frontal view the skull's texture continues where the face ends.
  const auto front_uv = [&](const cv::Vec3d& p) {
    const double x = std::clamp(px_per_mm_ * p[0] + px_origin_.x(), 1.0, wide.cols - 2.0);
    const double y = std::clamp(px_per_mm_ * p[1] + px_origin_.y(), 1.0, wide.rows - 2.0);
    return uv_of(x, y);
  };
  add_rings(
      mesh, kRings, kSegments,
      [&](int r, int s) {
        const double polar = std::numbers::pi * r / kRings;
        const double around = 2 * std::numbers::pi * s / kSegments;
        return cv::Vec3d(skull.center[0] + skull.radius[0] * std::sin(polar) * std::cos(around),
                         skull.center[1] - skull.radius[1] * std::cos(polar),
                         skull.center[2] - skull.radius[2] * std::sin(polar) * std::sin(around));
      },
      [&](const cv::Vec3f& p) {
        const double back = p[2] - (skull.center[2] - 0.35 * skull.radius[2]);
        // The hair's edge runs from the forehead down to behind the ears.
        return p[1] < hair_line || (back > 0 && p[1] < brow + 0.45 * height) ? 2 : 1;
      },
      front_uv);
  // The neck, slightly darker because it gets less light.
  mesh.materials.push_back({"neck", {0.72F, 0.72F, 0.72F}, 0});
  const double radius = 0.62 * skull.radius[0];
  const double chin = shape.row(1).maxCoeff();
  const Eigen::Index cheek = 4 < shape.cols() ? 4 : 0;
  const cv::Vec2f tone = uv_of(points_at_(0, cheek) + 2, points_at_(1, cheek));
  add_rings(
      mesh, 4, 24,
      [&](int r, int s) {
        const double around = 2 * std::numbers::pi * s / 24;
        return cv::Vec3d(skull.center[0] + radius * std::cos(around),
                         chin - 0.35 * height + r * 0.3 * height,
                         skull.center[2] + 0.1 * radius - radius * std::sin(around));
      },
      [](const cv::Vec3f&) { return 3; }, [&](const cv::Vec3d&) { return tone; });
  render::add_normals(mesh, 180);
  return mesh;
}

}  // namespace tarsier::synth
