// SPDX-License-Identifier: MIT
#include "tarsier/synth/observed_site.h"

#include "tarsier/core/at.h"
#include "tarsier/core/rng.h"
#include "tarsier/synth/full_turn.h"
#include "tarsier/synth/route.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <map>
#include <unordered_map>

namespace tarsier::synth {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kStep = 2.5;         // m, between images in a street
constexpr double kHalfStreet = 8;     // m
constexpr double kBlock = 60;         // m
constexpr double kSegment = 10;       // m, length of a facade section
constexpr double kFacadeHeight = 12;  // m
constexpr double kCorner = 8;         // m, of a street before and behind its corners
constexpr double kTurnLength = 20;    // m of path that count as much as one radian of rotation
constexpr int kModules = 6;           // facade designs that are repeated
constexpr int kMinMatches = 30;       // minimum matches of a pair
constexpr double kMinViewCosine =
    0.7;                        // cosine of the largest change of the viewing direction in a match
constexpr double kFocal = 500;  // px
constexpr int kSegmentsAhead = 8;
constexpr int kPerSegment = 130;  // number of points

// A point of a surface. Points that look alike have the same `appearance`.
struct SitePoint {
  Vector3d position;
  Vector3d normal;
  int appearance = 0;
};

geometry::Rigid3 pose_at(const Vector3d& center, const Vector3d& forward, Rng& rng) {
  Vector3d up = std::abs(forward.normalized().z()) > 0.9 ? Vector3d::UnitY() : Vector3d::UnitZ();
  const Vector3d z = forward.normalized();
  const Vector3d x = z.cross(up).normalized();
  geometry::Rigid3 pose;
  pose.rotation.row(0) = x.transpose();
  pose.rotation.row(1) = z.cross(x).transpose();
  pose.rotation.row(2) = z.transpose();
  const auto shake = [&](double by) {
    Vector3d offset;
    for (int k = 0; k < 3; ++k) offset[k] = rng.uniform(-by, by);
    return offset;
  };
  pose.rotation = geometry::rotation_by(shake(0.03)) * pose.rotation;
  pose.translation = -(pose.rotation * (center + shake(0.2)));
  return pose;
}

class Site {
 public:
  explicit Site(const SiteOptions& options) : options_(options), rng_(options.seed) {
    site_.camera.width = 640;
    site_.camera.height = 480;
    site_.camera.fx = site_.camera.fy = kFocal;
    site_.camera.cx = 319.5;
    site_.camera.cy = 239.5;
    appearance_count_ = kModules * kPerSegment;
  }

  ObservedSite make() {
    switch (options_.kind) {
      case SiteKind::kRing:
        ring();
        break;
      case SiteKind::kGrid:
        grid();
        break;
      case SiteKind::kWalk:
        walk();
        break;
      case SiteKind::kCity:
        city();
        break;
      case SiteKind::kSymmetric:
        symmetric();
        break;
    }
    observe();
    match();
    return std::move(site_);
  }

 private:
  // --- the world and the cameras ---

  // A facade between two points on the ground, with its front on the left. `module`: index of its
  // design; -1: unique.
  void facade(const Vector2d& from, const Vector2d& to, int module, double details = 0) {
    const Vector2d along = (to - from).normalized();
    const Vector3d normal(-along.y(), along.x(), 0);
    Rng design(module < 0 ? rng_() : 77 + at(module));
    const double length = (to - from).norm();
    for (int k = 0; k < kPerSegment; ++k) {
      const double x = design.uniform(0, length);
      const double depth = design.uniform(-0.8, 0.8);
      const double z = design.uniform(0, kFacadeHeight);
      const bool is_unique = module < 0 || rng_.uniform() < details;
      Vector3d position(from.x() + x * along.x(), from.y() + x * along.y(), z);
      // Its unique points also have other positions.
      if (is_unique && module >= 0) {
        const double x2 = rng_.uniform(0, length);
        position = {from.x() + x2 * along.x(), from.y() + x2 * along.y(),
                    rng_.uniform(0, kFacadeHeight)};
      }
      points_.push_back({position + depth * normal, normal,
                         is_unique ? appearance_count_++ : module * kPerSegment + k});
    }
  }

  // Facade sections along a polyline, on its left if side is 1, facing the line.
  void facades(const std::vector<Vector2d>& line, double side) {
    for (std::size_t k = 0; k + 1 < line.size(); ++k) {
      const int module = rng_.uniform() < options_.repeats ? rng_.integer(0, kModules - 1) : -1;
      const Vector2d along = (line[k + 1] - line[k]).normalized();
      const Vector2d left = side * kHalfStreet * Vector2d(-along.y(), along.x());
      if (side > 0)
        facade(line[k + 1] + left, line[k] + left, module);
      else
        facade(line[k] + left, line[k + 1] + left, module);
    }
  }

  void ring() {
    const double radius = std::max(25.0, options_.images * kStep / kTurn);
    const double inner = radius - kHalfStreet;
    const int segments = std::max(6, static_cast<int>(kTurn * inner / kSegment));
    const auto on_circle = [&](double part, double r) {
      return Vector2d(r * std::cos(kTurn * part), r * std::sin(kTurn * part));
    };
    for (int k = 0; k < segments; ++k) {
      const int module = rng_.uniform() < options_.repeats ? rng_.integer(0, kModules - 1) : -1;
      facade(on_circle((k + 1.0) / segments, inner), on_circle(1.0 * k / segments, inner), module);
    }
    for (int i = 0; i < options_.images; ++i) {
      const Vector2d c = on_circle(1.0 * i / options_.images, radius + 6);
      site_.poses.push_back(pose_at({c.x(), c.y(), rng_.uniform(3, 6)}, {-c.x(), -c.y(), 0}, rng_));
    }
  }

  void grid() {
    constexpr double kFlightHeight = 60;
    constexpr double kSpacing = 20;
    const int across = std::max(2, static_cast<int>(std::lround(std::sqrt(options_.images))));
    const double width = (across + 4) * kSpacing;
    const double length = (1.0 * options_.images / across + 4) * kSpacing;
    const int count = static_cast<int>(width * length * options_.features * 1.5 / (77 * 58));
    for (int k = 0; k < count; ++k)
      points_.push_back({{rng_.uniform(-2 * kSpacing, width - 2 * kSpacing),
                          rng_.uniform(-2 * kSpacing, length - 2 * kSpacing), rng_.uniform(-6, 6)},
                         Vector3d::UnitZ(),
                         appearance_count_++});
    for (int i = 0; i < options_.images; ++i) {
      const int row = i / across;
      const int column = row % 2 == 0 ? i % across : across - 1 - i % across;
      site_.poses.push_back(
          pose_at({column * kSpacing, row * kSpacing, kFlightHeight}, -Vector3d::UnitZ(), rng_));
    }
  }

  // Looks ahead and to the left.
  void add_camera(const Vector2d& at, const Vector2d& ahead) {
    const Vector2d left(-ahead.y(), ahead.x());
    const Vector2d view = ahead + 1.2 * left;
    site_.poses.push_back(
        pose_at({at.x(), at.y(), rng_.uniform(3, 5)}, {view.x(), view.y(), 0.15}, rng_));
  }

  void walk() {
    std::vector<Vector2d> line{{0, 0}};
    const int segments = std::max(3, static_cast<int>(options_.images * kStep / kSegment));
    for (int k = 0; k < segments; ++k) {
      const double heading = 0.9 * std::sin(k / 9.0);
      line.emplace_back(line.back() + kSegment * Vector2d(std::cos(heading), std::sin(heading)));
    }
    // The last cameras look ahead, so the facades continue beyond the end of the walk.
    std::vector<Vector2d> street = line;
    const Vector2d ahead = line.back() - line[line.size() - 2];
    for (int k = 0; k < kSegmentsAhead; ++k) street.emplace_back(street.back() + ahead);
    facades(street, 1);
    const Route route(line, 5, kCorner);
    for (int i = 0; i < options_.images; ++i) {
      const double position = i * route.length() / std::max(1, options_.images - 1);
      add_camera(route.at(position), route.ahead(position));
    }
  }

  void city() {
    const int streets = std::max(
        2, static_cast<int>(std::lround(std::sqrt(options_.images * kStep / (3 * kBlock)))));
    const double last = (streets - 1) * kBlock;
    const auto add_facade = [&](const Vector2d& from, const Vector2d& to) {
      const int module = rng_.uniform() < options_.repeats ? rng_.integer(0, kModules - 1) : -1;
      facade(from, to, module);
    };
    // The blocks, with one more row around all streets; each has a facade on each side.
    for (int a = 0; a <= streets; ++a) {
      for (int b = 0; b <= streets; ++b) {
        const Vector2d low((a - 1) * kBlock + kHalfStreet, (b - 1) * kBlock + kHalfStreet);
        const Vector2d high(a * kBlock - kHalfStreet, b * kBlock - kHalfStreet);
        const std::vector<Vector2d> corners{
            low, {low.x(), high.y()}, high, {high.x(), low.y()}, low};
        for (std::size_t side = 0; side < 4; ++side) {
          const int segments = static_cast<int>((kBlock - 2 * kHalfStreet) / kSegment);
          for (int k = 0; k < segments; ++k) {
            const auto corner = [&](double part) {
              return Vector2d(corners[side] + part * (corners[side + 1] - corners[side]));
            };
            add_facade(corner(1.0 * k / segments), corner((k + 1.0) / segments));
          }
        }
      }
    }
    // Houses close the streets at the border. Otherwise a camera that turns there would look along
    // an endless street and see hardly anything.
    for (int k = 0; k < streets; ++k) {
      for (const double offset : {-kHalfStreet, 0.0}) {
        const double from = k * kBlock + offset;
        const double to = from + kHalfStreet;
        add_facade({to, -kHalfStreet}, {from, -kHalfStreet});
        add_facade({from, last + kHalfStreet}, {to, last + kHalfStreet});
        add_facade({-kHalfStreet, from}, {-kHalfStreet, to});
        add_facade({last + kHalfStreet, to}, {last + kHalfStreet, from});
      }
    }
    // All streets in one direction, alternately there and back, then all in the other direction,
    // and those in the first direction again.
    std::vector<Vector2d> line;
    const auto drive_first_direction = [&] {
      for (int b = 0; b < streets; ++b) {
        line.emplace_back(b % 2 == 0 ? 0 : last, b * kBlock);
        line.emplace_back(b % 2 == 0 ? last : 0, b * kBlock);
      }
    };
    drive_first_direction();
    const bool ends_right = (streets - 1) % 2 == 0;
    for (int k = 0; k < streets; ++k) {
      const double x = (ends_right ? streets - 1 - k : k) * kBlock;
      line.emplace_back(x, k % 2 == 0 ? last : 0);
      line.emplace_back(x, k % 2 == 0 ? 0 : last);
    }
    line.emplace_back(0, line.back().y());
    drive_first_direction();
    std::vector<Vector2d> distinct;
    for (const Vector2d& p : line)
      if (distinct.empty() || (p - distinct.back()).norm() > 1) distinct.push_back(p);
    const Route route(distinct, kCorner, kCorner);
    for (const double position : route.positions(options_.images, kTurnLength))
      add_camera(route.at(position), route.ahead(position));
  }

  void symmetric() {
    constexpr double kRadius = 8;
    const auto corner = [&](int k) {
      const double angle = kTurn * k / options_.sides;
      return options_.sides == 2 && k >= 2
                 ? Vector2d(kRadius, 0)
                 : Vector2d(kRadius * std::cos(angle), kRadius * std::sin(angle));
    };
    for (int k = 0; k < options_.sides; ++k)
      for (int layer = 0; layer < 3; ++layer)
        facade(corner(k + 1), corner(k), layer, options_.details);
    for (int i = 0; i < options_.images; ++i) {
      const double angle = kTurn * i / options_.images;
      const Vector2d c(26 * std::cos(angle), 26 * std::sin(angle));
      site_.poses.push_back(pose_at({c.x(), c.y(), 9}, {-c.x(), -c.y(), -3}, rng_));
    }
  }

  // --- observations ---

  // Direction to the camera in the axes of the surface.
  static Vector3d view_direction(const SitePoint& point, const Vector3d& center) {
    const Vector3d to = (center - point.position).normalized();
    const Vector3d up = std::abs(point.normal.z()) > 0.9 ? Vector3d::UnitY() : Vector3d::UnitZ();
    const Vector3d right = up.cross(point.normal).normalized();
    return {to.dot(right), to.dot(point.normal.cross(right)), to.dot(point.normal)};
  }

  void observe() {
    constexpr double kMaxDistance = 45;
    constexpr double kCell = 50;
    const double max_distance = options_.kind == SiteKind::kGrid ? 120 : kMaxDistance;
    std::map<std::pair<int, int>, std::vector<int>> cells;
    const auto cell_of = [&](const Vector3d& p) {
      return std::pair(static_cast<int>(std::floor(p.x() / kCell)),
                       static_cast<int>(std::floor(p.y() / kCell)));
    };
    for (std::size_t p = 0; p < points_.size(); ++p)
      cells[cell_of(points_[p].position)].push_back(static_cast<int>(p));
    const int reach = static_cast<int>(std::ceil(max_distance / kCell));
    for (std::size_t i = 0; i < site_.poses.size(); ++i) {
      const geometry::Rigid3& pose = site_.poses[i];
      const Vector3d center = pose.center();
      const auto [cx, cy] = cell_of(center);
      std::vector<std::pair<int, cv::Point2d>> seen;
      for (int dx = -reach; dx <= reach; ++dx) {
        for (int dy = -reach; dy <= reach; ++dy) {
          const auto found = cells.find({cx + dx, cy + dy});
          if (found == cells.end()) continue;
          for (const int p : found->second) {
            const SitePoint& point = points_[at(p)];
            if ((point.position - center).norm() > max_distance ||
                view_direction(point, center).z() < 0.25)
              continue;
            const auto pixel = site_.camera.project(pose * point.position);
            if (!pixel || pixel->x < 0 || pixel->y < 0 || pixel->x > 639 || pixel->y > 479)
              continue;
            if (rng_.uniform() < options_.drop_out) continue;
            cv::Point2d noise;
            noise.x = rng_.normal();
            noise.y = rng_.normal();
            seen.emplace_back(p, *pixel + options_.noise_px * noise);
          }
        }
      }
      for (std::size_t k = seen.size(); k > 1; --k)
        std::swap(seen[k - 1], seen[at(rng_.integer(0, static_cast<int>(k) - 1))]);
      if (seen.size() > at(options_.features)) seen.resize(at(options_.features));
      site_.features.emplace_back();
      point_of_.emplace_back();
      for (const auto& [point, pixel] : seen) {
        site_.features.back().emplace_back(pixel);
        point_of_.back().push_back(point);
      }
    }
  }

  // Matches features that look alike, are seen from about the same side, and are unique in their
  // image.
  void match() {
    std::vector<std::map<int, int>> feature_of(site_.poses.size());  // for each look
    std::unordered_map<int, std::vector<int>> images_of;             // for each look
    for (std::size_t i = 0; i < site_.poses.size(); ++i) {
      for (std::size_t f = 0; f < point_of_[i].size(); ++f) {
        const auto [known, fresh] =
            feature_of[i].emplace(points_[at(point_of_[i][f])].appearance, static_cast<int>(f));
        if (!fresh) known->second = -1;
      }
      std::erase_if(feature_of[i], [](const auto& entry) { return entry.second < 0; });
      for (const auto& [appearance, feature] : feature_of[i])
        images_of[appearance].push_back(static_cast<int>(i));
    }
    std::map<std::pair<int, int>, ObservedSite::Pair> chosen;
    for (std::size_t i = 0; i < site_.poses.size(); ++i) {
      std::unordered_map<int, int> common;
      for (const auto& [appearance, feature] : feature_of[i])
        for (const int other : images_of[appearance])
          if (other != static_cast<int>(i)) ++common[other];
      std::vector<std::pair<int, int>> order;
      for (const auto& [other, count] : common)
        if (count >= kMinMatches) order.emplace_back(-count, other);
      std::sort(order.begin(), order.end());
      int made = 0;
      for (const auto& [count, other] : order) {
        if (made == options_.neighbours) break;
        const std::pair<int, int> key = std::minmax({static_cast<int>(i), other});
        if (chosen.contains(key)) {
          ++made;
          continue;
        }
        ObservedSite::Pair pair = matched(key.first, key.second, feature_of);
        if (pair.matches.size() < kMinMatches) continue;
        ++made;
        chosen.emplace(key, std::move(pair));
      }
    }
    for (auto& [key, pair] : chosen) site_.pairs.push_back(std::move(pair));
  }

  ObservedSite::Pair matched(int first, int second,
                             const std::vector<std::map<int, int>>& feature_of) {
    ObservedSite::Pair pair;
    pair.first = first;
    pair.second = second;
    const Vector3d a = site_.poses[at(first)].center();
    const Vector3d b = site_.poses[at(second)].center();
    std::size_t same = 0;
    for (const auto& [appearance, feature] : feature_of[at(first)]) {
      const auto other = feature_of[at(second)].find(appearance);
      if (other == feature_of[at(second)].end()) continue;
      const int p = point_of_[at(first)][at(feature)];
      const int q = point_of_[at(second)][at(other->second)];
      if (view_direction(points_[at(p)], a).dot(view_direction(points_[at(q)], b)) < kMinViewCosine)
        continue;
      if (rng_.uniform() < options_.wrong_share) {
        const auto count = static_cast<int>(site_.features[at(second)].size());
        pair.matches.emplace_back(feature, rng_.integer(0, count - 1));
      } else {
        pair.matches.emplace_back(feature, other->second);
        same += p == q ? 1 : 0;
      }
    }
    pair.same_place = 2 * same > pair.matches.size();
    return pair;
  }

  const SiteOptions& options_;
  Rng rng_;
  ObservedSite site_;
  std::vector<SitePoint> points_;
  int appearance_count_ = 0;
  std::vector<std::vector<int>> point_of_;  // for each feature
};

}  // namespace

ObservedSite make_observed_site(const SiteOptions& options) {
  options.check();
  return Site(options).make();
}

}  // namespace tarsier::synth
