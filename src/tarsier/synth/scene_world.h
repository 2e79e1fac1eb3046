// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/synth/scene_objects.h"

#include <cstddef>
#include <cstdint>
#include <vector>

// The scene of scene.h as a whole: the table, the wall, the objects and the light.
namespace tarsier::synth::still_life {

// A cluster of objects: rays that miss its bounding sphere skip all of them.
struct Group {
  std::size_t begin = 0;
  std::size_t end = 0;
  Vec center;
  float radius = 0;
};

struct Surface {
  Vec color;        // diffuse reflectance, linear RGB
  float gloss = 0;  // mirror reflection at normal incidence
  float focus = 1;  // 0: blurred reflection, 1: sharp
};

class Scene {
 public:
  explicit Scene(std::uint64_t seed);
  [[nodiscard]] Vec trace(const Ray& ray, int& id) const;

 private:
  [[nodiscard]] Hit nearest(const Ray& ray) const;
  [[nodiscard]] Surface surface(const Hit& hit, Vec p, Vec& normal) const;
  [[nodiscard]] float light_visibility(Vec p, Vec normal, const Object* self) const;
  [[nodiscard]] float light_transmission(const Object& object, Vec from, const Object* self) const;
  [[nodiscard]] float ambient_visibility(Vec p, Vec normal, const Object* self) const;
  [[nodiscard]] Vec environment(Vec direction, float focus) const;
  [[nodiscard]] Vec light_on(const Hit& hit, Vec p, Vec normal, const Surface& surface) const;

  Object& add(Kind kind, Vec base, Vec center, float radius, float turn, Vec color);
  void add_sphere(Kind kind, Vec center, float radius, Vec color, float turn = 0);

  static void set_bounds(Object& object, float bound_radius, float low, float high) {
    object.bound_radius = bound_radius;
    object.low = low;
    object.high = high;
  }
  void close_group(std::size_t begin);

  std::vector<Object> objects_;
  std::vector<Group> groups_;
  Vec to_light_ = unit({-0.62F, 0.78F, -0.52F});
  Vec light_ = Vec{1.0F, 0.93F, 0.82F} * 2.6F;
  Vec wall_ = srgb(150, 160, 158);
  Vec wood_ = srgb(150, 98, 58);
};

}  // namespace tarsier::synth::still_life
