// SPDX-License-Identifier: MIT
#include "tarsier/synth/sfm_scene_surface.h"

#include "tarsier/core/stop.h"
#include "tarsier/synth/full_turn.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace tarsier::synth {
namespace {

constexpr double kTouch = 1e-6;  // units; closer points are equal

class Triangulation {
 public:
  Triangulation(const HeightField& field, std::span<const Solid> solids,
                const geometry::Camera& camera, std::span<const geometry::Rigid3> poses,
                double step, const std::stop_token& stop)
      : field_(field), solids_(solids), camera_(camera), poses_(poses), step_(step), stop_(stop) {}

  void add_field(cv::Rect2d region) {
    const auto point_at = [&](double u, double v) {
      const double x = region.x + u * region.width;
      const double y = region.y + v * region.height;
      return Eigen::Vector3d(x, y, field_.height(x, y));
    };
    add_patch(point_at, steps_of(region.width), steps_of(region.height), nullptr);
  }

  // The faces of a solid; outside is the direction of du x dv. The bottom of a solid on the ground
  // has no face.
  void add_solid(const Solid& solid) {
    const double a = solid.half[0];
    const double b = solid.half[1];
    const double low = solid.bottom;
    const double high = solid.top;
    if (solid.form == Solid::Form::kColumn) {
      add_column(solid);
      return;
    }
    const auto add = [&](const Eigen::Vector3d& corner, const Eigen::Vector3d& along,
                         const Eigen::Vector3d& up) {
      add_face(solid, steps_of(along.norm()), steps_of(up.norm()),
               [&](double u, double v) { return Eigen::Vector3d(corner + u * along + v * up); });
    };
    const Eigen::Vector3d up(0, 0, high - low);
    if (solid.form == Solid::Form::kGable) {
      // The ends are triangles: they narrow to the ridge.
      for (const double side : {-1.0, 1.0}) {
        add_face(solid, steps_of(2 * b), steps_of(high - low), [&](double u, double v) {
          return Eigen::Vector3d(side * a, side * (2 * u - 1) * (1 - v) * b,
                                 low + v * (high - low));
        });
      }
      add({-a, -b, low}, {2 * a, 0, 0}, {0, b, high - low});
      add({a, b, low}, {-2 * a, 0, 0}, {0, -b, high - low});
    } else {
      add({-a, -b, low}, {2 * a, 0, 0}, up);
      add({a, -b, low}, {0, 2 * b, 0}, up);
      add({a, b, low}, {-2 * a, 0, 0}, up);
      add({-a, b, low}, {0, -2 * b, 0}, up);
      add({-a, -b, high}, {2 * a, 0, 0}, {0, 2 * b, 0});
    }
    if (low > 0) add({-a, b, low}, {2 * a, 0, 0}, {0, -2 * b, 0});
  }

  SceneSurface take() { return std::move(surface_); }

 private:
  // point_at(u, v) is in the axes of the solid.
  template <typename PointAt>
  void add_face(const Solid& solid, int across, int up, const PointAt& point_at) {
    const Eigen::Vector3d origin(solid.x, solid.y, 0);
    add_patch([&](double u,
                  double v) { return Eigen::Vector3d(origin + solid.from_local(point_at(u, v))); },
              across, up, &solid);
  }

  void add_column(const Solid& solid) {
    constexpr int kMinSides = 24;
    const double radius = solid.half[0];
    const int around = std::max(kMinSides, steps_of(kTurn * radius));
    const auto on_circle = [&](double part, double r, double z) {
      return Eigen::Vector3d(r * std::cos(kTurn * part), r * std::sin(kTurn * part), z);
    };
    add_face(solid, around, steps_of(solid.top - solid.bottom), [&](double u, double v) {
      return on_circle(u, radius, solid.bottom + v * (solid.top - solid.bottom));
    });
    add_face(solid, around, steps_of(radius),
             [&](double u, double v) { return on_circle(u, radius * (1 - v), solid.top); });
    if (solid.bottom > 0) {
      add_face(solid, around, steps_of(radius),
               [&](double u, double v) { return on_circle(u, radius * v, solid.bottom); });
    }
  }

  [[nodiscard]] int steps_of(double length) const {
    return std::max(1, static_cast<int>(std::ceil(length / step_)));
  }

  [[nodiscard]] bool is_in_view(const Eigen::Vector3d& at) const {
    return std::any_of(poses_.begin(), poses_.end(), [&](const geometry::Rigid3& pose) {
      const Eigen::Vector3d there = pose * at;
      if (!(there[2] > 0 && there[2] < kMaxDistance)) return false;
      const double u = camera_.fx * there[0] / there[2] + camera_.cx;
      const double v = camera_.fy * there[1] / there[2] + camera_.cy;
      return u > -0.5 && v > -0.5 && u < camera_.width - 0.5 && v < camera_.height - 0.5;
    });
  }

  // Below the field, or inside a solid other than `self`.
  [[nodiscard]] bool is_buried(const Eigen::Vector3d& at, const Solid* self) const {
    if (self != nullptr && at[2] < field_.height(at[0], at[1]) - kTouch) return true;
    return std::any_of(solids_.begin(), solids_.end(),
                       [&](const Solid& solid) { return &solid != self && solid.contains(at); });
  }

  // point_at(u, v), u and v from 0 to 1, in cells; cells entirely out of view or buried are
  // omitted.
  template <typename PointAt>
  void add_patch(const PointAt& point_at, int across, int down, const Solid* self) {
    const int stride = across + 1;
    std::vector<Eigen::Vector3d> points;
    std::vector<std::uint8_t> in_view;
    std::vector<std::uint8_t> is_free;
    for (int j = 0; j <= down; ++j) {
      throw_if_stopped(stop_);
      for (int i = 0; i <= across; ++i) {
        points.push_back(point_at(static_cast<double>(i) / across, static_cast<double>(j) / down));
        in_view.push_back(is_in_view(points.back()) ? 1 : 0);
        is_free.push_back(is_buried(points.back(), self) ? 0 : 1);
      }
    }
    std::vector<int> number(points.size(), -1);
    const auto vertex = [&](int k) {
      const auto at = static_cast<std::size_t>(k);
      if (number[at] < 0) {
        number[at] = static_cast<int>(surface_.vertices.size());
        surface_.vertices.emplace_back(points[at].cast<float>());
      }
      return number[at];
    };
    for (int j = 0; j < down; ++j) {
      for (int i = 0; i < across; ++i) {
        const int k = j * stride + i;
        const std::array<int, 4> corners{k, k + 1, k + stride + 1, k + stride};
        const auto any_of = [&](const std::vector<std::uint8_t>& flags) {
          return std::any_of(corners.begin(), corners.end(),
                             [&](int c) { return flags[static_cast<std::size_t>(c)] != 0; });
        };
        if (!any_of(in_view) || !any_of(is_free)) continue;
        const int a = vertex(corners[0]);
        const int b = vertex(corners[1]);
        const int c = vertex(corners[2]);
        const int d = vertex(corners[3]);
        surface_.triangles.push_back({a, b, c});
        surface_.triangles.push_back({a, c, d});
      }
    }
  }

  const HeightField& field_;
  std::span<const Solid> solids_;
  const geometry::Camera& camera_;
  std::span<const geometry::Rigid3> poses_;
  double step_;
  const std::stop_token& stop_;
  SceneSurface surface_;
};

}  // namespace

SceneSurface triangulate(const HeightField& field, std::span<const Solid> solids,
                         const geometry::Camera& camera, std::span<const geometry::Rigid3> poses,
                         cv::Rect2d region, double step, const std::stop_token& stop) {
  Triangulation triangulation(field, solids, camera, poses, step, stop);
  triangulation.add_field(region);
  for (const Solid& solid : solids) triangulation.add_solid(solid);
  return triangulation.take();
}

}  // namespace tarsier::synth
