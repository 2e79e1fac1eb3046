// SPDX-License-Identifier: MIT
#include "tarsier/synth/sfm_scene_streets.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tarsier::synth {
namespace {

using Eigen::Vector2d;

constexpr double kStep = 1.8;        // units, between images of a walk
constexpr double kCityStep = 2.5;    // of a city, maximum
constexpr double kHalfStreet = 7;    // units
constexpr double kLot = 10;          // units of a street per house, of a walk
constexpr double kBlock = 40;        // units between streets
constexpr int kLotsOfBlock = 3;      // on each of its sides
constexpr double kDeep = 8;          // units, depth of a house
constexpr int kModules = 6;          // house designs that are repeated
constexpr int kLotsAhead = 8;        // visible from the end of a walk
constexpr double kHousePitch = 4.5;  // units between houses of a village

// splitmix64's mixing (Steele, Lea and Flood, OOPSLA 2014).
std::uint64_t mixed(std::uint64_t value) {
  value += 0x9e3779b97f4a7c15ULL;
  value = (value ^ (value >> 30U)) * 0xbf58476d1ce4e5b9ULL;
  value = (value ^ (value >> 27U)) * 0x94d049bb133111ebULL;
  return value ^ (value >> 31U);
}

// Builds houses along the sides of streets.
class Builder {
 public:
  Builder(double repeats, Rng rng) : repeats_(repeats), rng_(rng), designs_(rng.fork(1)) {}

  // A house whose front is between two points on the ground, on the left of the path from one to
  // the other.
  void build(const Vector2d& from, const Vector2d& to) {
    const std::uint64_t design =
        rng_.uniform() < repeats_ ? static_cast<std::uint64_t>(rng_.integer(1, kModules)) : next_++;
    Rng rng = designs_.fork(design);
    const Vector2d along = (to - from).normalized();
    const Vector2d front(-along.y(), along.x());
    const double length = (to - from).norm();
    const double setback = rng.uniform(0, 1.2);
    Solid solid;
    solid.cosine = along.x();
    solid.sine = along.y();
    solid.half[0] = length / 2;
    solid.half[1] = kDeep / 2;
    solid.top = rng.uniform(6, 11);
    const Vector2d middle = (from + to) / 2 - (setback + kDeep / 2) * front;
    solid.x = middle.x();
    solid.y = middle.y();
    House house;
    house.design = design;
    house.window_pitch[0] = rng.uniform(1.7, 2.5);
    house.window_pitch[1] = rng.uniform(2.2, 2.9);
    house.window_half[0] = house.window_pitch[0] * rng.uniform(0.22, 0.32);
    house.window_half[1] = house.window_pitch[1] * rng.uniform(0.25, 0.32);
    house.frame = static_cast<float>(rng.uniform(30, 225));
    streets_.solids.push_back(solid);
    streets_.houses.push_back(house);
    const int bays = rng.integer(1, 2);
    for (int k = 0; k < bays; ++k) {
      Solid bay = solid;
      bay.half[0] = rng.uniform(0.4, 0.9);
      bay.half[1] = rng.uniform(0.3, 0.6);
      bay.bottom = rng.uniform(0, 1) < 0.5 ? 0 : rng.uniform(1.5, 3);
      bay.top = std::min(solid.top, bay.bottom + rng.uniform(2, 4));
      const Vector2d place =
          (from + to) / 2 - setback * front + rng.uniform(-0.4, 0.4) * length * along;
      bay.x = place.x();
      bay.y = place.y();
      House bay_house = house;
      bay_house.design = design + 1'000'000 * static_cast<std::uint64_t>(k + 1);
      bay_house.has_windows = false;
      streets_.solids.push_back(bay);
      streets_.houses.push_back(bay_house);
    }
  }

  Streets finish(std::vector<Vector2d> path) {
    streets_.path = std::move(path);
    return std::move(streets_);
  }

 private:
  double repeats_;
  Rng rng_;
  Rng designs_;
  std::uint64_t next_ = kModules + 1;
  Streets streets_;
};

}  // namespace

cv::Vec3f patchwork(const Texture& texture, double width, double height, std::uint64_t key,
                    double u, double v, double footprint) {
  const std::uint64_t bits = mixed(key);
  const auto part = [bits](unsigned number) {
    return static_cast<double>((bits >> (16 * number)) & 0xffffU) / 65536;
  };
  const cv::Vec3f first = texture.at(u + part(0) * width, v + part(1) * height, footprint);
  const cv::Vec3f second = texture.at(v + part(2) * width, part(3) * height - u, footprint);
  constexpr float kContrast = 1.35F;
  cv::Vec3f colour;
  for (int c = 0; c < 3; ++c)
    colour[c] = std::clamp(128 + kContrast * ((first[c] + second[c]) / 2 - 128), 4.F, 251.F);
  return colour;
}

Streets make_walk(int images, double repeats, Rng rng) {
  std::vector<Vector2d> path{{0, 0}};
  const int lots = std::max(2, static_cast<int>(std::ceil(images * kStep / kLot)));
  for (int k = 0; k < lots + kLotsAhead; ++k) {
    const double heading = 0.9 * std::sin(k / 9.0);
    path.emplace_back(path.back() + kLot * Vector2d(std::cos(heading), std::sin(heading)));
  }
  Builder builder(repeats, rng);
  for (std::size_t k = 0; k + 1 < path.size(); ++k) {
    const Vector2d along = (path[k + 1] - path[k]).normalized();
    const Vector2d left = kHalfStreet * Vector2d(-along.y(), along.x());
    builder.build(path[k + 1] + left, path[k] + left);
  }
  path.resize(static_cast<std::size_t>(lots) + 1);
  return builder.finish(std::move(path));
}

Streets make_city(int images, double repeats, Rng rng) {
  const int streets =
      std::max(2, static_cast<int>(std::lround(std::sqrt(images * kCityStep / (2 * kBlock)))));
  Builder builder(repeats, rng);
  // The blocks, with one more row around all streets.
  for (int a = 0; a <= streets; ++a) {
    for (int b = 0; b <= streets; ++b) {
      const Vector2d low((a - 1) * kBlock + kHalfStreet, (b - 1) * kBlock + kHalfStreet);
      const Vector2d high(a * kBlock - kHalfStreet, b * kBlock - kHalfStreet);
      const std::vector<Vector2d> corners{low, {low.x(), high.y()}, high, {high.x(), low.y()}, low};
      for (std::size_t side = 0; side < 4; ++side) {
        const Vector2d across = (corners[side + 1] - corners[side]) / kLotsOfBlock;
        for (int k = 0; k < kLotsOfBlock; ++k)
          builder.build(corners[side] + k * across, corners[side] + (k + 1) * across);
      }
    }
  }
  // All streets in one direction, alternately there and back, then all in the other direction.
  std::vector<Vector2d> path;
  const auto add_waypoint = [&](double x, double y) {
    if (path.empty() || (Vector2d(x, y) - path.back()).norm() > 1) path.emplace_back(x, y);
  };
  const double last = (streets - 1) * kBlock;
  for (int b = 0; b < streets; ++b) {
    add_waypoint(b % 2 == 0 ? 0 : last, b * kBlock);
    add_waypoint(b % 2 == 0 ? last : 0, b * kBlock);
  }
  const bool ends_right = (streets - 1) % 2 == 0;
  for (int k = 0; k < streets; ++k) {
    const double x = (ends_right ? streets - 1 - k : k) * kBlock;
    add_waypoint(x, k % 2 == 0 ? last : 0);
    add_waypoint(x, k % 2 == 0 ? 0 : last);
  }
  return builder.finish(std::move(path));
}

Streets make_village(const cv::Rect2d& region, Rng rng) {
  Streets village;
  std::uint64_t design = kModules + 1;
  for (double y = region.y; y < region.br().y; y += kHousePitch) {
    for (double x = region.x; x < region.br().x; x += kHousePitch) {
      if (rng.uniform() < 0.5) continue;
      Solid solid;
      solid.x = x + rng.uniform(-0.8, 0.8);
      solid.y = y + rng.uniform(-0.8, 0.8);
      for (double& half : solid.half) half = rng.uniform(0.35, 0.9);
      const double turn = rng.uniform(0, std::numbers::pi);
      solid.cosine = std::cos(turn);
      solid.sine = std::sin(turn);
      solid.top = rng.uniform(0.5, 1.4);  // above the ground, which has its own height
      for (int c = 0; c < 3; ++c) solid.tint[c] = static_cast<float>(rng.uniform(0.72, 1.08));
      House house;
      house.design = design++;
      house.has_windows = false;
      village.solids.push_back(solid);
      village.houses.push_back(house);
    }
  }
  return village;
}

cv::Vec3f house_colour(const House& house, const Solid& solid, int face,
                       const Eigen::Vector3d& local, const Texture& texture, double width,
                       double height, double footprint) {
  const cv::Point2d at = solid.on_face(face, local);
  const std::uint64_t key = 8 * house.design + static_cast<std::uint64_t>(face);
  if (house.has_windows && face < kTopFace) {
    // Position relative to the centre of the nearest window.
    const double across = at.x - house.window_pitch[0] * std::floor(at.x / house.window_pitch[0]) -
                          house.window_pitch[0] / 2;
    const double above = local[2] -
                         house.window_pitch[1] * std::floor(local[2] / house.window_pitch[1]) -
                         house.window_pitch[1] / 2;
    constexpr double kFrame = 0.1;  // units
    const double right = std::abs(across) - house.window_half[0];
    const double up = std::abs(above) - house.window_half[1];
    if (right < 0 && up < 0) {
      if (right > -kFrame || up > -kFrame) return {house.frame, house.frame, house.frame};
      return 0.6F *
             patchwork(texture, width, height, 8 * house.design + 7, across, above, footprint);
    }
  }
  return patchwork(texture, width, height, key, at.x, at.y, footprint);
}

}  // namespace tarsier::synth
