// SPDX-License-Identifier: MIT
#include "tarsier/synth/relief_surface.h"

#include "tarsier/core/stop.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace tarsier::synth {
namespace {

constexpr double kTouch = 1e-6;  // units: closer is the same place

class Triangulation {
 public:
  Triangulation(const HeightField& field, std::span<const Box> boxes,
                const geometry::Camera& camera, std::span<const geometry::Rigid3> poses,
                double step, const std::stop_token& stop)
      : field_(field), boxes_(boxes), camera_(camera), poses_(poses), step_(step), stop_(stop) {}

  void add_field(cv::Rect2d region) {
    const auto place = [&](double u, double v) {
      const double x = region.x + u * region.width;
      const double y = region.y + v * region.height;
      return Eigen::Vector3d(x, y, field_.height(x, y));
    };
    add_patch(place, steps_of(region.width), steps_of(region.height), nullptr);
  }

  // Four sides and the top: outside lies where du x dv points.
  void add_box(const Box& box) {
    const double a = box.half[0];
    const double b = box.half[1];
    const auto add = [&](const Eigen::Vector3d& corner, const Eigen::Vector3d& along,
                         const Eigen::Vector3d& up) {
      const Eigen::Vector3d origin(box.x, box.y, 0);
      const auto place = [&](double u, double v) {
        return Eigen::Vector3d(origin + box.from_own(corner + u * along + v * up));
      };
      add_patch(place, steps_of(along.norm()), steps_of(up.norm()), &box);
    };
    const Eigen::Vector3d up(0, 0, box.top);
    add({-a, -b, 0}, {2 * a, 0, 0}, up);
    add({a, -b, 0}, {0, 2 * b, 0}, up);
    add({a, b, 0}, {-2 * a, 0, 0}, up);
    add({-a, b, 0}, {0, -2 * b, 0}, up);
    add({-a, -b, box.top}, {2 * a, 0, 0}, {0, 2 * b, 0});
  }

  SceneSurface take() { return std::move(surface_); }

 private:
  [[nodiscard]] int steps_of(double length) const {
    return std::max(1, static_cast<int>(std::ceil(length / step_)));
  }

  [[nodiscard]] bool is_in_view(const Eigen::Vector3d& at) const {
    return std::any_of(poses_.begin(), poses_.end(), [&](const geometry::Rigid3& pose) {
      const Eigen::Vector3d there = pose * at;
      if (!(there[2] > 0)) return false;
      const double u = camera_.fx * there[0] / there[2] + camera_.cx;
      const double v = camera_.fy * there[1] / there[2] + camera_.cy;
      return u > -0.5 && v > -0.5 && u < camera_.width - 0.5 && v < camera_.height - 0.5;
    });
  }

  // Below the field, or in a box other than `own`.
  [[nodiscard]] bool is_buried(const Eigen::Vector3d& at, const Box* own) const {
    if (own != nullptr && at[2] < field_.height(at[0], at[1]) - kTouch) return true;
    return std::any_of(boxes_.begin(), boxes_.end(),
                       [&](const Box& box) { return &box != own && box.contains(at); });
  }

  // place(u, v), u and v from 0 to 1, in cells; without cells that are out of view or buried as a whole.
  template <typename Place>
  void add_patch(const Place& place, int across, int down, const Box* own) {
    const int stride = across + 1;
    std::vector<Eigen::Vector3d> points;
    std::vector<std::uint8_t> in_view;
    std::vector<std::uint8_t> is_free;
    for (int j = 0; j <= down; ++j) {
      throw_if_stopped(stop_);
      for (int i = 0; i <= across; ++i) {
        points.push_back(place(static_cast<double>(i) / across, static_cast<double>(j) / down));
        in_view.push_back(is_in_view(points.back()) ? 1 : 0);
        is_free.push_back(is_buried(points.back(), own) ? 0 : 1);
      }
    }
    std::vector<int> number(points.size(), -1);
    const auto vertex = [&](int k) {
      const auto at = static_cast<std::size_t>(k);
      if (number[at] < 0) {
        number[at] = static_cast<int>(surface_.vertices.size());
        surface_.vertices.push_back(points[at].cast<float>());
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
  std::span<const Box> boxes_;
  const geometry::Camera& camera_;
  std::span<const geometry::Rigid3> poses_;
  double step_;
  const std::stop_token& stop_;
  SceneSurface surface_;
};

}  // namespace

SceneSurface triangulate(const HeightField& field, std::span<const Box> boxes,
                         const geometry::Camera& camera, std::span<const geometry::Rigid3> poses,
                         cv::Rect2d region, double step, const std::stop_token& stop) {
  Triangulation triangulation(field, boxes, camera, poses, step, stop);
  triangulation.add_field(region);
  for (const Box& box : boxes) triangulation.add_box(box);
  return triangulation.take();
}

}  // namespace tarsier::synth
