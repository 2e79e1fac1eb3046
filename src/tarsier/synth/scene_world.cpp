// SPDX-License-Identifier: MIT
#include "tarsier/synth/scene_world.h"

#include "tarsier/core/rng.h"

#include <array>

namespace tarsier::synth::still_life {
namespace {

const Vec kFloorGlow = srgb(70, 58, 48);
const Vec kCeilingGlow = srgb(176, 180, 184);
const Vec kFloorLight = srgb(116, 100, 86);
const Vec kSkyLight = srgb(176, 190, 206);

constexpr float kSpread = 0.11F;  // tangent of the lamp's half angle

}  // namespace

Object& Scene::add(Kind kind, Vec base, Vec center, float radius, float turn, Vec color) {
  Object object;
  object.kind = kind;
  object.base = base;
  object.center = base + center;
  object.radius = radius;
  object.shade_radius = radius * 0.75F;
  object.turn_cos = std::cos(turn);
  object.turn_sin = std::sin(turn);
  object.color = color;
  objects_.push_back(object);
  return objects_.back();
}

void Scene::add_sphere(Kind kind, Vec center, float radius, Vec color, float turn) {
  add(kind, center, {}, radius, turn, color).shade_radius = radius;
}

// Makes a group of the objects from index `begin` on.
void Scene::close_group(std::size_t begin) {
  Group group;
  group.begin = begin;
  group.end = objects_.size();
  const auto count = static_cast<float>(group.end - begin);
  for (std::size_t i = begin; i < group.end; ++i)
    group.center = group.center + objects_[i].center * (1 / count);
  for (std::size_t i = begin; i < group.end; ++i) {
    group.radius =
        std::max(group.radius, length(objects_[i].center - group.center) + objects_[i].radius);
  }
  groups_.push_back(group);
}

Scene::Scene(std::uint64_t seed) {
  Rng rng(seed);
  const bool is_composed = seed == 1;
  const auto shift = [&](double by) {
    const double value = rng.uniform(-by, by);
    return is_composed ? 0.0F : static_cast<float>(value);
  };
  const auto tint = [&](Vec color) {
    if (is_composed) return color;
    const auto vary = [&](float c) {
      return std::clamp(c * static_cast<float>(rng.uniform(0.6, 1.5)), 0.01F, 0.9F);
    };
    return Vec{vary(color.x), vary(color.y), vary(color.z)};
  };
  wall_ = tint(wall_);
  wood_ = tint(wood_);

  const float books_x = -1.25F + shift(0.08);
  add(Kind::kBook, {books_x, 0.15F, 0.95F}, {}, 0.92F, 0.25F + shift(0.3), tint(srgb(122, 30, 36)))
      .height = 0.15F;
  add(Kind::kBook, {books_x + 0.06F, 0.40F, 0.92F}, {}, 0.91F, -0.12F + shift(0.3),
      tint(srgb(26, 82, 92)))
      .height = 0.10F;
  add_sphere(Kind::kOrange, {books_x + shift(0.15), 0.89F, 0.85F}, 0.39F, tint(srgb(240, 128, 14)));
  add(Kind::kVase, {0.18F + shift(0.12), 0, 1.15F + shift(0.15)}, {0, 0.75F, 0}, 0.86F, shift(3),
      tint(srgb(226, 228, 226)));
  const Vec vase = objects_.back().base;
  add(Kind::kMug, {1.38F + shift(0.1), 0, 0.55F + shift(0.2)}, {0.1F, 0.45F, 0}, 0.76F,
      -0.5F + shift(0.5), tint(srgb(214, 72, 48)));
  add(Kind::kApple, {-0.42F + shift(0.12), 0, -0.2F + shift(0.2)}, {0, 0.5F, 0}, 0.58F, shift(3),
      tint(srgb(188, 22, 24)));
  add(Kind::kPear, {0.58F + shift(0.1), 0, 0.1F + shift(0.2)}, {0.03F, 0.6F, 0}, 0.72F,
      0.8F + shift(3), tint(srgb(186, 176, 44)));
  add_sphere(Kind::kBall, {-1.28F + shift(0.2), 0.33F, -0.45F + shift(0.2)}, 0.33F,
             tint(srgb(34, 74, 150)), 0.5F + shift(3));
  for (Object& object : objects_) {
    switch (object.kind) {
      case Kind::kApple:
        set_bounds(object, 0.53F, -0.01F, 1.06F);
        break;
      case Kind::kPear:
        set_bounds(object, 0.43F, -0.01F, 1.31F);
        break;
      case Kind::kVase:
        set_bounds(object, 0.52F, -0.01F, 1.51F);
        break;
      case Kind::kMug:
        set_bounds(object, 0.73F, 0, 0.91F);
        break;
      case Kind::kBook:
        set_bounds(object, 0.92F, -object.height - 0.01F, object.height + 0.01F);
        break;
      default:
        break;
    }
  }
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    Group single{i, i + 1, objects_[i].center, objects_[i].radius};
    groups_.push_back(single);
  }
  // A heap of grapes.
  const std::size_t grapes = objects_.size();
  static constexpr std::array<std::array<float, 3>, 9> kGrapes = {{{0, 0, 0},
                                                                   {0.27F, 0, 0.05F},
                                                                   {0.12F, 0, 0.24F},
                                                                   {-0.16F, 0, 0.22F},
                                                                   {0.40F, 0, 0.27F},
                                                                   {0.14F, 0.22F, 0.10F},
                                                                   {0.29F, 0.21F, 0.20F},
                                                                   {0.02F, 0.21F, 0.2F},
                                                                   {0.55F, 0, 0.02F}}};
  const Vec heap{0.82F + shift(0.15), 0.145F, -0.75F + shift(0.1)};
  for (std::size_t i = 0; i < kGrapes.size(); ++i) {
    const auto& g = kGrapes[i];
    add_sphere(Kind::kGrape, heap + Vec{g[0], g[1], g[2]},
               0.132F + 0.013F * hash(static_cast<int>(i), 3, 5),
               mix(srgb(74, 22, 66), srgb(112, 34, 58), hash(static_cast<int>(i), 1, 2)));
  }
  close_group(grapes);
  const std::size_t leaves = objects_.size();
  // Leaves in the vase: flat ellipsoids along arcs from its mouth.
  for (int i = 0; i < 13; ++i) {
    const float angle = 2.4F * static_cast<float>(i) + shift(0.5);
    const float lean = 0.25F + 0.6F * hash(i, 7, 1);
    const Vec out{std::cos(angle) * lean, 1, 0.6F * std::sin(angle) * lean};
    const Vec along = unit(out);
    const Vec side = unit(cross(along, Vec{std::sin(angle * 1.7F), 0.35F, std::cos(angle * 1.3F)}));
    const Vec flat = cross(along, side);
    const float reach = 0.3F + 0.42F * hash(i, 2, 9);
    Object& leaf = add(Kind::kLeaf, vase, Vec{0, 1.42F, 0} + along * reach, 0.27F, 0,
                       mix(srgb(46, 92, 34), srgb(116, 138, 62), hash(i, 5, 5)));
    leaf.axis_u = along * 0.27F;
    leaf.axis_v = side * (0.085F + 0.03F * hash(i, 4, 4));
    leaf.axis_w = flat * 0.012F;
    leaf.shade_radius = 0;
  }
  close_group(leaves);
}

Hit Scene::nearest(const Ray& ray) const {
  Hit hit;
  if (ray.direction.z > 1e-6F) {
    hit.t = (kWall - ray.from.z) / ray.direction.z;
    hit.normal = {0, 0, -1};
  }
  if (ray.direction.y < -1e-6F) {
    const float t = -ray.from.y / ray.direction.y;
    if (t < hit.t) {
      hit.t = t;
      hit.kind = Kind::kTable;
      hit.normal = {0, 1, 0};
    }
  }
  for (const Group& group : groups_) {
    float enter = 0;
    float leave = 0;
    if (!cut_sphere(ray, group.center, group.radius, enter, leave) || enter >= hit.t) continue;
    for (std::size_t i = group.begin; i < group.end; ++i) intersect(objects_[i], ray, hit);
  }
  return hit;
}

// Visible share of the area lamp, 0..1.
float Scene::light_visibility(Vec p, Vec normal, const Object* self) const {
  float seen = 1;
  const Vec from = p + normal * 0.012F;
  for (const Group& group : groups_) {
    const Vec to_group = group.center - from;
    const float group_along = dot(to_group, to_light_);
    if (group_along < -group.radius) continue;
    const float group_reach =
        group.radius + kSpread * (group_along + group.radius + 0.05F) + 0.004F;
    if (dot(to_group, to_group) - group_along * group_along > group_reach * group_reach) continue;
    for (std::size_t i = group.begin; i < group.end; ++i) {
      seen *= light_transmission(objects_[i], from, self);
      if (seen < 0.004F) return 0;
    }
  }
  return seen;
}

// Visible share of the lamp past one object.
float Scene::light_transmission(const Object& object, Vec from, const Object* self) const {
  const Vec to = object.center - from;
  const float along = dot(to, to_light_);
  if (along < -object.radius) return 1;
  const float width = kSpread * std::max(along, 0.05F) + 0.004F;
  const float gap2 = dot(to, to) - along * along;
  const float reach = object.radius + width;
  if (gap2 > reach * reach) return 1;
  const float gap = std::sqrt(std::max(gap2, 0.0F));
  if (object.is_sphere() || object.kind == Kind::kLeaf) {
    if (&object == self || along <= 0) return 1;
    if (object.is_sphere()) return smoothstep(object.radius - width, object.radius + width, gap);
    const float size = 0.12F;  // thinner than its bounding sphere
    return 1 - 0.6F * (1 - smoothstep(size - width, size + width, gap));
  }
  // The penumbra extends beyond the object itself.
  Object wider = object;
  wider.bound_radius += width;
  wider.low -= width;
  wider.high += width;
  float enter = std::max(0.015F, along - object.radius);
  float end = along + object.radius;
  if (!cut_cylinder(wider, {from, to_light_}, enter, end)) return 1;
  float t = enter;
  float min_clearance = 1;
  for (int step = 0; step < 22 && t < end && min_clearance > -1; ++step) {
    const float distance = distance_to(object, from + to_light_ * t);
    min_clearance = std::min(min_clearance, distance / (kSpread * t + 0.004F));
    t += std::clamp(std::abs(distance), 0.02F, 0.25F);
  }
  return smoothstep(-1, 1, min_clearance);
}

// Visible share of the surroundings: nearby objects darken.
float Scene::ambient_visibility(Vec p, Vec normal, const Object* self) const {
  float open = 1;
  for (const Object& object : objects_) {
    if (&object == self) continue;
    const Vec to = object.center - p;
    const float distance2 = dot(to, to);
    const float r = object.shade_radius;
    if (distance2 >= 16 * r * r) continue;
    const float distance = std::sqrt(distance2);
    const float facing = std::clamp(dot(normal, to) / distance * 0.8F + 0.2F, 0.0F, 1.0F);
    open *= 1 - 0.75F * facing * std::min(1.0F, r * r / distance2);
  }
  if (self != nullptr) open *= mix(0.55F, 1, smoothstep(-0.2F, 0.5F, p.y + 0.3F * normal.y));
  return std::max(open, 0.12F);
}

// Environment for reflections: a room with a window of four panes on the left.
Vec Scene::environment(Vec d, float focus) const {
  const float up = 0.5F + 0.5F * d.y;
  Vec room = mix(kFloorGlow, kCeilingGlow, up) * 0.8F;
  const Vec side = unit(cross(to_light_, {0, 1, 0}));
  const Vec top = cross(side, to_light_);
  const float facing = dot(d, to_light_);
  if (facing > 0.2F) {
    const float u = dot(d, side) / facing;
    const float v = dot(d, top) / facing;
    const float soft = mix(0.30F, 0.03F, focus);
    const auto inside = [soft](float x, float half) {
      return 1 - smoothstep(half - soft, half + soft, std::abs(x));
    };
    const float panes = inside(u, 0.34F) * inside(v, 0.42F);
    const float bars = focus * std::max(inside(u, 0.02F), inside(v, 0.02F)) * 0.8F;
    room = room + light_ * (2.4F * mix(0.45F, 1.0F, focus) * panes * (1 - bars));
  }
  return room;
}

// Light that leaves `p` by diffuse reflection.
Vec Scene::light_on(const Hit& hit, Vec p, Vec normal, const Surface& surface) const {
  const float facing = std::max(0.0F, dot(normal, to_light_));
  float direct = facing > 0 ? facing * light_visibility(p, normal, hit.object) : 0;
  if (hit.kind == Kind::kPlaster) {
    // Window bars and a tree outside make the light on the wall uneven.
    const float u = p.x + 0.55F * p.y;
    const float v = p.y - 0.1F * p.x;
    const auto edge = [](float x, float low, float high) {
      return smoothstep(low - 0.09F, low + 0.09F, x) *
             (1 - smoothstep(high - 0.09F, high + 0.09F, x));
    };
    const float window = edge(u, -1.3F, 0.45F) + edge(u, 0.62F, 2.4F);
    const float rows = edge(v, 0.2F, 1.45F) + edge(v, 1.6F, 3.2F);
    const float tree = smoothstep(0.30F, 0.62F, fractal_noise(p * 1.6F + Vec{5, 0, 0}, 3));
    direct *= 0.35F + 0.65F * window * rows * (0.45F + 0.55F * tree);
  }
  const float open = ambient_visibility(p, normal, hit.object);
  const Vec sky = mix(kFloorLight, kSkyLight, 0.5F + 0.5F * normal.y) * 0.52F;
  // The lit table reflects warm light up to the objects.
  const Vec bounce = wood_ * (0.55F * std::max(0.0F, -normal.y * 0.7F + 0.3F));
  return surface.color * (light_ * direct + (sky + bounce) * open);
}

Vec Scene::trace(const Ray& ray, int& id) const {
  const Hit hit = nearest(ray);
  id = hit.object != nullptr ? static_cast<int>(hit.object - objects_.data()) + 2
                             : static_cast<int>(hit.kind == Kind::kTable);
  const Vec p = ray.from + ray.direction * hit.t;
  Vec normal = hit.normal;
  const Surface s = surface(hit, p, normal);
  Vec color = light_on(hit, p, normal, s);
  if (s.gloss > 0) {
    const float cosine = std::clamp(-dot(normal, ray.direction), 0.0F, 1.0F);
    const float grazing = 1 - cosine;
    const float square = grazing * grazing;
    const float fresnel =
        s.gloss + (0.65F - s.gloss) * square * square * grazing * (0.3F + 0.7F * s.focus);
    const Vec mirrored = ray.direction + normal * (2 * cosine);
    Vec seen{};
    const Ray second{p + hit.normal * 0.01F, mirrored};
    Hit other;
    // Only strong reflections get a ray; the table's reflection is blurred by its roughness.
    if (fresnel > 0.03F && mirrored.y < 0.9F) other = nearest(second);
    if (other.t < 6 && (other.object != nullptr || other.kind == Kind::kTable) && fresnel > 0.03F) {
      const Vec q = second.from + mirrored * other.t;
      Vec other_normal = other.normal;
      const Surface other_surface = surface(other, q, other_normal);
      const Vec reflected = light_on(other, q, other_normal, other_surface);
      const float blur = hit.kind == Kind::kTable ? 1 - smoothstep(0.0F, 1.2F, other.t) : 1;
      seen = mix(environment(mirrored, s.focus) * 0.5F, reflected, blur);
    } else {
      seen = environment(mirrored, s.focus) * ambient_visibility(p, normal, hit.object);
    }
    color = color + seen * fresnel;
  }
  return color;
}

}  // namespace tarsier::synth::still_life
