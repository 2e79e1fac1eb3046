// SPDX-License-Identifier: MIT
#include "tarsier/synth/scene.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

namespace tarsier {
namespace {

// World: x right, y up, z away from the camera, about decimetres. The table is y = 0, the wall z =
// kWall.
struct Vec {
  float x = 0;
  float y = 0;
  float z = 0;
};
Vec operator+(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
Vec operator-(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
Vec operator*(Vec a, float s) { return {a.x * s, a.y * s, a.z * s}; }
Vec operator*(Vec a, Vec b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
float dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Vec cross(Vec a, Vec b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
float length(Vec a) { return std::sqrt(dot(a, a)); }
Vec unit(Vec a) { return a * (1 / length(a)); }
Vec mix(Vec a, Vec b, float t) { return a + (b - a) * t; }
float mix(float a, float b, float t) { return a + (b - a) * t; }
float step_between(float low, float high, float x) {
  const float t = std::clamp((x - low) / (high - low), 0.0F, 1.0F);
  return t * t * (3 - 2 * t);
}
// sRGB, as a designer states it, to linear light.
Vec srgb(int r, int g, int b) {
  const auto linear = [](int v) { return std::pow(static_cast<float>(v) / 255, 2.2F); };
  return {linear(r), linear(g), linear(b)};
}

// Colours of things.
const Vec kStraw = srgb(226, 158, 58);
const Vec kFloorGlow = srgb(70, 58, 48);
const Vec kCeilingGlow = srgb(176, 180, 184);
const Vec kNavel = srgb(98, 110, 40);
const Vec kBloom = srgb(150, 140, 170);
const Vec kCream = srgb(232, 226, 210);
const Vec kVein = srgb(170, 184, 110);
const Vec kAppleStem = srgb(86, 62, 36);
const Vec kHollow = srgb(150, 158, 52);
const Vec kSpeckle = srgb(232, 196, 120);
const Vec kPearStem = srgb(84, 64, 40);
const Vec kRusset = srgb(190, 122, 52);
const Vec kCobalt = srgb(28, 58, 132);
const Vec kCoffee = srgb(46, 24, 12);
const Vec kGlaze = srgb(226, 220, 206);
const Vec kSlip = srgb(240, 232, 214);
const Vec kPaperDark = srgb(176, 160, 128);
const Vec kPaper = srgb(236, 226, 200);
const Vec kGold = srgb(206, 168, 84);
const Vec kFloorLight = srgb(116, 100, 86);
const Vec kSkyLight = srgb(176, 190, 206);

float hash(int x, int y, int z) {
  std::uint32_t h = static_cast<std::uint32_t>(x) * 0x8da6b343U ^
                    static_cast<std::uint32_t>(y) * 0xd8163841U ^
                    static_cast<std::uint32_t>(z) * 0xcb1ab31fU;
  h ^= h >> 15U;
  h *= 0x2c1b3c6dU;
  h ^= h >> 12U;
  h *= 0x297a2d39U;
  h ^= h >> 15U;
  return static_cast<float>(h & 0xffffffU) * (1.0F / 16777216.0F);
}

// Smooth noise in [0, 1] with features of size 1.
float noise(Vec p) {
  const auto floor_of = [](float v) {  // std::floor is a call without SSE4.1
    const int i = static_cast<int>(v);
    return i - static_cast<int>(static_cast<float>(i) > v);
  };
  const int x = floor_of(p.x);
  const int y = floor_of(p.y);
  const int z = floor_of(p.z);
  const auto fx = static_cast<float>(x);
  const auto fy = static_cast<float>(y);
  const auto fz = static_cast<float>(z);
  const auto fade = [](float t) { return t * t * (3 - 2 * t); };
  const float u = fade(p.x - fx);
  const float v = fade(p.y - fy);
  const float w = fade(p.z - fz);
  const auto line = [&](int dy, int dz) {
    return mix(hash(x, y + dy, z + dz), hash(x + 1, y + dy, z + dz), u);
  };
  return mix(mix(line(0, 0), line(1, 0), v), mix(line(0, 1), line(1, 1), v), w);
}

float rough(Vec p, int octaves) {
  float sum = 0;
  float weight = 0.5F;
  for (int i = 0; i < octaves; ++i) {
    sum += weight * noise(p);
    p = p * 2.03F + Vec{17.1F, 3.7F, 9.2F};
    weight *= 0.5F;
  }
  return sum;
}

constexpr float kWall = 2.6F;
constexpr float kFar = 1e9F;
constexpr float kSpread = 0.11F;  // tangent of the lamp's half angle

enum class Kind {
  kTable,
  kPlaster,
  kOrange,
  kGrape,
  kBall,
  kLeaf,
  kApple,
  kPear,
  kVase,
  kMug,
  kBook
};

struct Object {
  Kind kind = Kind::kOrange;
  Vec center;          // of the bounding sphere
  float radius = 0;    // of the bounding sphere; of the sphere itself for orange, grape, ball
  Vec base;            // origin of the object's own coordinates
  float turn_cos = 1;  // about the vertical axis
  float turn_sin = 0;
  Vec color;
  Vec axis_u;  // leaf: half axes, orthogonal
  Vec axis_v;
  Vec axis_w;
  float height = 0;        // book: half thickness
  float shade_radius = 0;  // how it darkens its neighbourhood
  float girth = 0;  // kinds with a distance function lie within this distance of their axis ..
  float low = 0;    // .. and between these heights above `base`
  float high = 0;

  [[nodiscard]] bool is_sphere() const {
    return kind == Kind::kOrange || kind == Kind::kGrape || kind == Kind::kBall;
  }
  [[nodiscard]] Vec to_own(Vec p) const {
    const Vec q = p - base;
    return {turn_cos * q.x + turn_sin * q.z, q.y, -turn_sin * q.x + turn_cos * q.z};
  }
};

float rounded_box(Vec p, Vec half, float rounding) {
  const Vec q{std::abs(p.x) - half.x, std::abs(p.y) - half.y, std::abs(p.z) - half.z};
  const Vec outside{std::max(q.x, 0.0F), std::max(q.y, 0.0F), std::max(q.z, 0.0F)};
  return length(outside) + std::min(std::max({q.x, q.y, q.z}), 0.0F) - rounding;
}

float capsule(Vec p, Vec a, Vec b, float radius) {
  const Vec pa = p - a;
  const Vec ba = b - a;
  const float h = std::clamp(dot(pa, ba) / dot(ba, ba), 0.0F, 1.0F);
  return length(pa - ba * h) - radius;
}

float smooth_min(float a, float b, float k) {
  const float h = std::clamp(0.5F + 0.5F * (b - a) / k, 0.0F, 1.0F);
  return mix(b, a, h) - k * h * (1 - h);
}

float vase_radius(float y) {
  // Foot, belly, neck and lip of a vase 1.5 high.
  const float off = std::clamp((y - 0.55F) * (y - 0.55F) / 0.64F, 0.0F, 1.0F);
  const float belly = 0.36F * (1 - off) * (1 - off) * (1 - off) * (1 - off);
  const float lip = 0.10F * step_between(1.2F, 1.5F, y);
  const float foot = 0.09F * (1 - step_between(0.0F, 0.16F, y));
  return 0.13F + belly + lip + foot;
}

// Distance to the surface, or a little less.
float distance_to(const Object& object, Vec world) {
  const Vec p = object.to_own(world);
  switch (object.kind) {
    case Kind::kApple: {  // 0.5 radius, its centre 0.46 above the table
      const Vec q{p.x, p.y - 0.46F, p.z};
      const float around = q.x * q.x + q.z * q.z;
      // Written so that both ends fade out before they meet.
      const float dimple = around > 0.2F ? 0 : (q.y > 0 ? 0.13F : 0.07F) * std::exp(-around * 26);
      const float taper = 0.05F * (0.46F - q.y) * step_between(0.0F, 0.6F, 0.46F - q.y);
      const float flesh = (length({q.x, q.y * 1.06F, q.z}) - 0.5F + dimple + taper) * 0.8F;
      if (q.y < 0.2F) return flesh;
      return std::min(flesh, capsule(q, {0, 0.3F, 0}, {0.06F, 0.56F, 0.02F}, 0.018F));
    }
    case Kind::kPear: {
      const float low = length(p - Vec{0, 0.4F, 0}) - 0.4F;
      const float high = length(p - Vec{0.05F, 0.9F, 0}) - 0.2F;
      const float flesh = smooth_min(low, high, 0.32F) * 0.9F;
      if (p.y < 0.9F) return flesh;
      return std::min(flesh, capsule(p, {0.06F, 1.05F, 0}, {0.12F, 1.27F, 0.03F}, 0.018F));
    }
    case Kind::kVase: {
      const float around = std::sqrt(p.x * p.x + p.z * p.z);
      const float wall = (around - vase_radius(p.y)) * 0.75F;
      const float ends = std::max(-p.y, p.y - 1.5F);
      const float hollow = vase_radius(p.y) - 0.035F - around;  // open at the top
      const float shell = p.y > 0.9F ? std::max(wall, hollow * 0.75F) : wall;
      return std::max(shell, ends);
    }
    case Kind::kMug: {
      const float around = std::sqrt(p.x * p.x + p.z * p.z);
      const auto barrel = [&](float radius, float low, float high) {
        return std::max(around - radius, std::max(low - p.y, p.y - high));
      };
      const float body = std::max(barrel(0.4F, 0.02F, 0.88F), -barrel(0.36F, 0.7F, 2.0F)) - 0.012F;
      const Vec q = p - Vec{0.42F, 0.46F, 0};
      const float ring = std::sqrt(q.x * q.x + q.y * q.y) - 0.24F;
      const float handle = std::sqrt(ring * ring + q.z * q.z * 0.6F) - 0.05F;
      return smooth_min(body, std::max(handle, 0.37F - around), 0.05F);
    }
    case Kind::kBook:
      return rounded_box(p, {0.72F, object.height - 0.02F, 0.5F}, 0.02F);
    default:
      return kFar;
  }
}

struct Ray {
  Vec from;
  Vec direction;
};

struct Hit {
  float t = kFar;
  const Object* object = nullptr;  // null: table or wall
  Kind kind = Kind::kPlaster;
  Vec normal;
};

// The part of the ray inside a sphere; false if it misses.
bool cut_sphere(const Ray& ray, Vec center, float radius, float& enter, float& leave) {
  const Vec to = center - ray.from;
  const float along = dot(to, ray.direction);
  const float gap = dot(to, to) - along * along;
  if (gap > radius * radius) return false;
  const float half = std::sqrt(radius * radius - gap);
  enter = along - half;
  leave = along + half;
  return leave > 0;
}

// Narrows [enter, leave] to where the ray is inside the upright cylinder that holds the object.
bool cut_cylinder(const Object& object, const Ray& ray, float& enter, float& leave) {
  const Vec from = ray.from - object.base;
  if (std::abs(ray.direction.y) > 1e-6F) {
    const float a = (object.low - from.y) / ray.direction.y;
    const float b = (object.high - from.y) / ray.direction.y;
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  } else if (from.y < object.low || from.y > object.high) {
    return false;
  }
  const float a = ray.direction.x * ray.direction.x + ray.direction.z * ray.direction.z;
  const float b = from.x * ray.direction.x + from.z * ray.direction.z;
  const float c = from.x * from.x + from.z * from.z - object.girth * object.girth;
  if (a > 1e-6F) {
    const float disc = b * b - a * c;
    if (disc < 0) return false;
    const float root = std::sqrt(disc);
    enter = std::max(enter, (-b - root) / a);
    leave = std::min(leave, (-b + root) / a);
  } else if (c > 0) {
    return false;
  }
  return enter < leave && leave > 0;
}

Vec distance_normal(const Object& object, Vec p) {
  constexpr float e = 0.0015F;
  const float a = distance_to(object, p + Vec{e, -e, -e});
  const float b = distance_to(object, p + Vec{-e, -e, e});
  const float c = distance_to(object, p + Vec{-e, e, -e});
  const float d = distance_to(object, p + Vec{e, e, e});
  return unit({a - b - c + d, -a - b + c + d, -a + b - c + d});
}

void intersect(const Object& object, const Ray& ray, Hit& hit) {
  float enter = 0;
  float leave = 0;
  if (!cut_sphere(ray, object.center, object.radius, enter, leave) || enter >= hit.t) return;
  if (object.is_sphere()) {
    if (enter <= 0) return;
    hit.t = enter;
    hit.object = &object;
    hit.kind = object.kind;
    hit.normal = unit(ray.from + ray.direction * enter - object.center);
    return;
  }
  if (object.kind == Kind::kLeaf) {
    // An ellipsoid is a unit sphere in coordinates stretched by its half axes.
    const auto own = [&](Vec v) {
      return Vec{dot(v, object.axis_u) / dot(object.axis_u, object.axis_u),
                 dot(v, object.axis_v) / dot(object.axis_v, object.axis_v),
                 dot(v, object.axis_w) / dot(object.axis_w, object.axis_w)};
    };
    const Vec o = own(ray.from - object.center);
    const Vec d = own(ray.direction);
    const float a = dot(d, d);
    const float b = dot(o, d);
    const float disc = b * b - a * (dot(o, o) - 1);
    if (disc < 0) return;
    const float t = (-b - std::sqrt(disc)) / a;
    if (t <= 0 || t >= hit.t) return;
    const Vec q = o + d * t;
    hit.t = t;
    hit.object = &object;
    hit.kind = object.kind;
    hit.normal = unit(object.axis_u * (q.x / dot(object.axis_u, object.axis_u)) +
                      object.axis_v * (q.y / dot(object.axis_v, object.axis_v)) +
                      object.axis_w * (q.z / dot(object.axis_w, object.axis_w)));
    return;
  }
  if (!cut_cylinder(object, ray, enter, leave)) return;
  const float end = std::min(leave, hit.t);
  float t = std::max(enter, 0.0F);
  for (int step = 0; step < 96 && t < end; ++step) {
    const float distance = distance_to(object, ray.from + ray.direction * t);
    if (distance < 0.0006F * std::max(1.0F, 0.3F * t)) {
      hit.t = t;
      hit.object = &object;
      hit.kind = object.kind;
      hit.normal = distance_normal(object, ray.from + ray.direction * t);
      return;
    }
    t += distance;
  }
}

// Objects that are near each other: rays that miss the whole skip them all.
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
  [[nodiscard]] float sun(Vec p, Vec normal, const Object* self) const;
  [[nodiscard]] float past_object(const Object& object, Vec from, const Object* self) const;
  [[nodiscard]] float openness(Vec p, Vec normal, const Object* self) const;
  [[nodiscard]] Vec surroundings(Vec direction, float focus) const;
  [[nodiscard]] Vec light_on(const Hit& hit, Vec p, Vec normal, const Surface& surface) const;

  Object& add(Kind kind, Vec base, Vec center, float radius, float turn, Vec color);
  void add_sphere(Kind kind, Vec center, float radius, Vec color, float turn = 0);

  static void set_bounds(Object& object, float girth, float low, float high) {
    object.girth = girth;
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

// Makes a group of the objects from `begin` on.
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
  // Leaves in the vase: flat ellipsoids along arcs out of its mouth.
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

// How much of the lamp, an area, is seen: 0..1.
float Scene::sun(Vec p, Vec normal, const Object* self) const {
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
      seen *= past_object(objects_[i], from, self);
      if (seen < 0.004F) return 0;
    }
  }
  return seen;
}

// How much of the lamp is seen past one object.
float Scene::past_object(const Object& object, Vec from, const Object* self) const {
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
    if (object.is_sphere()) return step_between(object.radius - width, object.radius + width, gap);
    const float size = 0.12F;  // thinner than its bounding sphere
    return 1 - 0.6F * (1 - step_between(size - width, size + width, gap));
  }
  // The half shadow reaches beyond the object itself.
  Object wider = object;
  wider.girth += width;
  wider.low -= width;
  wider.high += width;
  float enter = std::max(0.015F, along - object.radius);
  float end = along + object.radius;
  if (!cut_cylinder(wider, {from, to_light_}, enter, end)) return 1;
  float t = enter;
  float least = 1;
  for (int step = 0; step < 22 && t < end && least > -1; ++step) {
    const float distance = distance_to(object, from + to_light_ * t);
    least = std::min(least, distance / (kSpread * t + 0.004F));
    t += std::clamp(std::abs(distance), 0.02F, 0.25F);
  }
  return step_between(-1, 1, least);
}

// How much of the room is seen: objects close by darken.
float Scene::openness(Vec p, Vec normal, const Object* self) const {
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
  if (self != nullptr) open *= mix(0.55F, 1, step_between(-0.2F, 0.5F, p.y + 0.3F * normal.y));
  return std::max(open, 0.12F);
}

// What a mirror sees: a room with a window of four panes on the left.
Vec Scene::surroundings(Vec d, float focus) const {
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
      return 1 - step_between(half - soft, half + soft, std::abs(x));
    };
    const float panes = inside(u, 0.34F) * inside(v, 0.42F);
    const float bars = focus * std::max(inside(u, 0.02F), inside(v, 0.02F)) * 0.8F;
    room = room + light_ * (2.4F * mix(0.45F, 1.0F, focus) * panes * (1 - bars));
  }
  return room;
}

Surface Scene::surface(const Hit& hit, Vec p, Vec& normal) const {
  Surface s;
  const Object* object = hit.object;
  const Vec own = object != nullptr ? object->to_own(p) : p;
  const auto bump = [&](Vec at, float scale, float height) {
    const float n = noise(at * scale);
    constexpr float e = 0.35F;
    const Vec slope{noise(at * scale + Vec{e, 0, 0}) - n, noise(at * scale + Vec{0, e, 0}) - n,
                    noise(at * scale + Vec{0, 0, e}) - n};
    normal = unit(normal - slope * height);
  };
  switch (hit.kind) {
    case Kind::kPlaster: {
      s.color = wall_ * (0.88F + 0.24F * rough(p * 1.3F, 3));
      bump(p, 14, 0.10F);
      break;
    }
    case Kind::kTable: {
      // Boards along x, each with its own grain.
      const float board = std::floor((p.z + 10) / 0.62F);
      const float across = (p.z + 10) / 0.62F - board;
      const int number = static_cast<int>(board);
      const Vec q{p.x * 0.55F + 31 * hash(number, 1, 1), static_cast<float>(number) * 7.3F,
                  p.z * 5};
      const float warp = rough(q, 3);
      const float rings = 0.5F + 0.5F * std::sin((p.z * 9 + warp * 13 + q.x * 0.6F) * 2.2F);
      const float fibre = noise({p.x * 7, static_cast<float>(number), p.z * 110});
      const float light = 0.72F + 0.30F * rings * (0.4F + warp) + 0.22F * (fibre - 0.5F) +
                          0.25F * (hash(number, 8, 3) - 0.5F);
      s.color = mix(wood_ * 0.55F, wood_ * 1.15F, std::clamp(light, 0.0F, 1.0F));
      const float gap = std::min(across, 1 - across);
      s.color = s.color * mix(0.25F, 1, step_between(0.004F, 0.022F, gap));
      s.gloss = 0.035F;
      s.focus = 0.15F;
      break;
    }
    case Kind::kOrange: {
      const Vec q = (p - object->center) * (1 / object->radius);
      s.color = object->color * (0.85F + 0.3F * rough(q * 3, 2));
      bump(q, 22, 0.30F);
      const float navel = step_between(0.90F, 0.985F, dot(unit(q), unit(Vec{0.45F, 0.75F, -0.5F})));
      s.color = mix(s.color, kNavel, navel * 0.8F);
      s.gloss = 0.04F;
      s.focus = 0.25F;
      break;
    }
    case Kind::kGrape: {
      const Vec q = (p - object->center) * (1 / object->radius);
      const float bloom = rough(q * 2.5F + object->center * 5, 3);
      s.color = mix(object->color, kBloom, 0.35F * step_between(0.35F, 0.75F, bloom));
      s.gloss = 0.045F;
      s.focus = 0.75F;
      break;
    }
    case Kind::kBall: {
      const Vec q = own * (1 / object->radius);
      const float turn = std::atan2(q.z, q.x) / 6.2831853F * 12;
      const float lift = std::asin(std::clamp(q.y, -1.0F, 1.0F)) / 3.1415927F * 6;
      const bool is_dark =
          ((static_cast<int>(std::floor(turn)) + static_cast<int>(std::floor(lift))) & 1) != 0;
      s.color = is_dark ? object->color : kCream;
      s.color = s.color * (0.94F + 0.12F * noise(q * 9));
      s.gloss = 0.05F;
      s.focus = 1;
      break;
    }
    case Kind::kLeaf: {
      const Vec q = p - object->center;
      const float across = dot(q, object->axis_v) / dot(object->axis_v, object->axis_v);
      const float along = dot(q, object->axis_u) / dot(object->axis_u, object->axis_u);
      const float vein = 1 - step_between(0.03F, 0.09F, std::abs(across));
      const float ribs = 0.5F + 0.5F * std::sin((along * 9 + std::abs(across) * 4) * 3);
      s.color = mix(object->color * (0.8F + 0.25F * ribs), kVein, 0.6F * vein);
      s.gloss = 0.03F;
      s.focus = 0.2F;
      break;
    }
    case Kind::kApple: {
      const Vec q{own.x, own.y - 0.46F, own.z};
      const float around = std::sqrt(q.x * q.x + q.z * q.z);
      if (around < 0.1F && q.y > 0.34F && length(q) > 0.36F &&
          around < 0.045F + 0.1F * (q.y - 0.34F)) {
        s.color = kAppleStem;  // the stem
        break;
      }
      const float turn = std::atan2(q.z, q.x);
      const float streak = noise({std::cos(turn) * 7, q.y * 1.6F, std::sin(turn) * 7});
      const float fine = noise({std::cos(turn) * 26, q.y * 3, std::sin(turn) * 26});
      const float blush =
          step_between(0.12F, 0.62F, streak * 0.6F + fine * 0.4F + 0.22F * std::sin(turn + 1.4F));
      s.color = mix(kStraw, object->color, 0.45F + 0.55F * blush);
      s.color = mix(kHollow, s.color, step_between(0.03F, 0.26F, around));
      const float speckle = noise(q * 38);
      s.color = mix(s.color, kSpeckle, 0.7F * step_between(0.84F, 0.92F, speckle));
      s.gloss = 0.045F;
      s.focus = 0.8F;
      break;
    }
    case Kind::kPear: {
      if (own.y > 1.11F) {
        s.color = kPearStem;
        break;
      }
      const float patch = rough(own * 2.4F, 3);
      s.color = mix(object->color, kRusset, step_between(0.42F, 0.75F, patch + 0.18F * own.x));
      const float speckle = noise(own * 30);
      s.color = s.color * mix(1.0F, 0.55F, step_between(0.76F, 0.9F, speckle));
      s.gloss = 0.035F;
      s.focus = 0.3F;
      break;
    }
    case Kind::kVase: {
      s.color = object->color;
      const Vec blue = kCobalt;
      const float turn = std::atan2(own.z, own.x);
      const auto band = [&](float middle, float half) {
        return 1 - step_between(half - 0.006F, half + 0.006F, std::abs(own.y - middle));
      };
      const float wave = 0.55F + 0.13F * std::sin(turn * 7);
      const float petals = 1 - step_between(0.0F, 0.25F,
                                            std::abs(std::sin(turn * 3.5F)) -
                                                0.8F * (1 - std::abs(own.y - 0.55F) / 0.26F));
      const float inside_belt = 1 - step_between(0.26F, 0.28F, std::abs(own.y - 0.55F));
      const float paint = std::max({band(0.88F, 0.018F), band(0.22F, 0.018F), band(0.94F, 0.007F),
                                    band(0.17F, 0.007F), band(1.46F, 0.02F),
                                    1 - step_between(0.015F, 0.028F, std::abs(own.y - wave)),
                                    petals * inside_belt * 0.85F});
      s.color = mix(s.color, blue, paint * (0.75F + 0.25F * noise(own * 16)));
      s.gloss = 0.06F;
      s.focus = 1;
      break;
    }
    case Kind::kMug: {
      const float around = std::sqrt(own.x * own.x + own.z * own.z);
      const bool is_inside = around < 0.37F && own.y < 0.87F && own.y > 0.5F;
      s.color = is_inside ? (own.y < 0.73F ? kCoffee : kGlaze) : object->color;
      if (!is_inside && around < 0.43F && own.y > 0.3F && own.y < 0.62F) {
        const float zig =
            0.46F +
            0.07F * (std::abs(std::fmod(std::atan2(own.z, own.x) * 5 + 40, 2.0F) - 1) - 0.5F) * 2;
        s.color = mix(kSlip, s.color, step_between(0.022F, 0.034F, std::abs(own.y - zig)));
      }
      s.gloss = is_inside ? 0.02F : 0.055F;
      s.focus = 0.9F;
      break;
    }
    case Kind::kBook: {
      const bool is_edge = std::abs(own.y) < object->height - 0.035F &&
                           (own.x > 0.70F || std::abs(own.z) > 0.49F) && own.x > -0.66F;
      if (is_edge) {
        const float leaf = noise({own.x * 2, own.y * 260, own.z * 2});
        s.color = mix(kPaperDark, kPaper, leaf);
        break;
      }
      const float weave = noise({own.x * 120, own.y * 120, own.z * 120});
      s.color = object->color * (0.8F + 0.35F * weave);
      const bool is_spine = own.x < -0.69F;
      const bool is_gold = is_spine ? std::abs(std::abs(own.z) - 0.3F) < 0.012F ||
                                          (std::abs(own.z) < 0.14F && std::abs(own.y) < 0.02F)
                                    : std::abs(std::abs(own.x) - 0.6F) < 0.008F ||
                                          std::abs(std::abs(own.z) - 0.42F) < 0.008F;
      if (is_gold) s.color = kGold;
      s.gloss = 0.02F;
      s.focus = 0.1F;
      break;
    }
  }
  return s;
}

// Light that leaves `p` by diffuse reflection.
Vec Scene::light_on(const Hit& hit, Vec p, Vec normal, const Surface& surface) const {
  const float facing = std::max(0.0F, dot(normal, to_light_));
  float direct = facing > 0 ? facing * sun(p, normal, hit.object) : 0;
  if (hit.kind == Kind::kPlaster) {
    // Window bars and a tree outside make the light on the wall uneven.
    const float u = p.x + 0.55F * p.y;
    const float v = p.y - 0.1F * p.x;
    const auto edge = [](float x, float low, float high) {
      return step_between(low - 0.09F, low + 0.09F, x) *
             (1 - step_between(high - 0.09F, high + 0.09F, x));
    };
    const float window = edge(u, -1.3F, 0.45F) + edge(u, 0.62F, 2.4F);
    const float rows = edge(v, 0.2F, 1.45F) + edge(v, 1.6F, 3.2F);
    const float tree = step_between(0.30F, 0.62F, rough(p * 1.6F + Vec{5, 0, 0}, 3));
    direct *= 0.35F + 0.65F * window * rows * (0.45F + 0.55F * tree);
  }
  const float open = openness(p, normal, hit.object);
  const Vec sky = mix(kFloorLight, kSkyLight, 0.5F + 0.5F * normal.y) * 0.52F;
  // The lit table throws warm light up on what stands on it.
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
    // Only the strong reflections are worth a ray; the table's is blurred by its roughness.
    if (fresnel > 0.03F && mirrored.y < 0.9F) other = nearest(second);
    if (other.t < 6 && (other.object != nullptr || other.kind == Kind::kTable) && fresnel > 0.03F) {
      const Vec q = second.from + mirrored * other.t;
      Vec other_normal = other.normal;
      const Surface other_surface = surface(other, q, other_normal);
      const Vec reflected = light_on(other, q, other_normal, other_surface);
      const float blur = hit.kind == Kind::kTable ? 1 - step_between(0.0F, 1.2F, other.t) : 1;
      seen = mix(surroundings(mirrored, s.focus) * 0.5F, reflected, blur);
    } else {
      seen = surroundings(mirrored, s.focus) * openness(p, normal, hit.object);
    }
    color = color + seen * fresnel;
  }
  return color;
}

std::uint8_t develop_exactly(float light) {
  // A film's shoulder, then the display's gamma.
  const float exposed = light * 1.05F;
  const float film = exposed * (1 + exposed * 0.10F) / (1 + exposed * 0.55F) * 1.12F;
  return static_cast<std::uint8_t>(
      std::clamp(255 * std::pow(std::max(film, 0.0F), 1 / 2.2F) + 0.5F, 0.0F, 255.0F));
}

// The same from a table over the square root of the light, which spreads the dark tones.
std::uint8_t develop(float light) {
  static constexpr int kSteps = 8192;
  static constexpr float kBrightest = 16;
  static const std::vector<std::uint8_t> table = [] {
    std::vector<std::uint8_t> values(kSteps + 1);
    for (int i = 0; i <= kSteps; ++i) {
      const float root = static_cast<float>(i) / kSteps;
      values[static_cast<std::size_t>(i)] = develop_exactly(root * root * kBrightest);
    }
    return values;
  }();
  const float root = std::sqrt(std::clamp(light / kBrightest, 0.0F, 1.0F));
  return table[static_cast<std::size_t>(root * kSteps + 0.5F)];
}

}  // namespace

cv::Mat render_scene(cv::Size size, double time_s, std::uint64_t seed) {
  TARSIER_REQUIRE(
      size.width >= 16 && size.height >= 16 && size.width <= 16384 && size.height <= 16384,
      "{}x{} px", size.width, size.height);
  TARSIER_REQUIRE(std::isfinite(time_s), "time {}", time_s);
  const Scene scene(seed);
  const auto sway = static_cast<float>(std::sin(0.45 * time_s));
  const auto bob = static_cast<float>(std::sin(0.31 * time_s + 1) - std::sin(1.0));
  const Vec eye{0.42F * sway, 2.15F + 0.10F * bob, -6.0F};
  const Vec target{0.04F * sway, 0.80F, 0.3F};
  const Vec forward = unit(target - eye);
  const Vec right = unit(cross({0, 1, 0}, forward));
  const Vec up = cross(forward, right);
  // 4:3 and wider show the same height; narrower pictures the same width.
  const float half_height = 0.262F * std::max(1.0F, 1.25F * static_cast<float>(size.height) /
                                                        static_cast<float>(size.width));
  const float scale = 2 * half_height / static_cast<float>(size.height);
  const float center_x = 0.5F * static_cast<float>(size.width);
  const float center_y = 0.5F * static_cast<float>(size.height);
  const auto sample = [&](float x, float y, int& id) {
    const Vec direction =
        unit(forward + right * ((x - center_x) * scale) + up * ((center_y - y) * scale));
    const Vec light = scene.trace({eye, direction}, id);
    const float off_x = (x - center_x) / center_x;
    const float off_y = (y - center_y) / center_y;
    return light * (1 - 0.14F * (off_x * off_x + off_y * off_y));  // vignetting
  };

  cv::Mat light(size, CV_32FC3);
  cv::Mat ids(size, CV_32SC1);
  cv::parallel_for_(cv::Range(0, size.height), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      for (int x = 0; x < size.width; ++x) {
        const Vec c =
            sample(static_cast<float>(x) + 0.5F, static_cast<float>(y) + 0.5F, ids.at<int>(y, x));
        light.at<cv::Vec3f>(y, x) = {c.z, c.y, c.x};
      }
    }
  });

  // Where something changes from pixel to pixel, more samples: edges as smooth as a lens makes
  // them.
  cv::Mat image(size, CV_8UC3);
  cv::parallel_for_(cv::Range(0, size.height), [&](const cv::Range& rows) {
    static constexpr std::array<std::array<float, 2>, 4> kOffsets = {
        {{-0.125F, -0.375F}, {0.375F, -0.125F}, {0.125F, 0.375F}, {-0.375F, 0.125F}}};
    for (int y = rows.start; y < rows.end; ++y) {
      for (int x = 0; x < size.width; ++x) {
        const cv::Vec3f here = light.at<cv::Vec3f>(y, x);
        const int id = ids.at<int>(y, x);
        bool is_edge = false;
        for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
          const int nx = std::clamp(x + dx, 0, size.width - 1);
          const int ny = std::clamp(y + dy, 0, size.height - 1);
          const cv::Vec3f there = light.at<cv::Vec3f>(ny, nx);
          is_edge = is_edge || ids.at<int>(ny, nx) != id ||
                    std::abs(there[1] - here[1]) > 0.10F + 0.30F * here[1];
        }
        cv::Vec3f sum = here;
        float count = 1;
        if (is_edge) {
          for (const auto& offset : kOffsets) {
            int ignored = 0;
            const Vec c = sample(static_cast<float>(x) + 0.5F + offset[0],
                                 static_cast<float>(y) + 0.5F + offset[1], ignored);
            // Highlights far brighter than white would make jagged edges: they count as white.
            sum += cv::Vec3f(std::min(c.z, 2.0F), std::min(c.y, 2.0F), std::min(c.x, 2.0F));
            count += 1;
          }
        }
        auto& pixel = image.at<cv::Vec3b>(y, x);
        for (int k = 0; k < 3; ++k) pixel[k] = develop(sum[k] / count);
      }
    }
  });
  return image;
}

cv::Mat render_bars(cv::Size size, std::int64_t frame) {
  TARSIER_REQUIRE(size.width >= 16 && size.height >= 16, "{}x{} px", size.width, size.height);
  cv::Mat image(size, CV_8UC3);
  static const std::array<cv::Scalar, 8> kColors = {
      cv::Scalar(191, 191, 191), cv::Scalar(0, 191, 191), cv::Scalar(191, 191, 0),
      cv::Scalar(0, 191, 0),     cv::Scalar(191, 0, 191), cv::Scalar(0, 0, 191),
      cv::Scalar(191, 0, 0),     cv::Scalar(0, 0, 0)};
  const int bars_height = size.height * 6 / 10;
  const int ramp_height = size.height * 8 / 10;
  for (int i = 0; i < 8; ++i) {
    const int left = size.width * i / 8;
    const int right = size.width * (i + 1) / 8;
    image(cv::Rect(left, 0, right - left, bars_height)).setTo(kColors[static_cast<std::size_t>(i)]);
  }
  for (int x = 0; x < size.width; ++x) {
    image(cv::Rect(x, bars_height, 1, ramp_height - bars_height))
        .setTo(cv::Scalar::all(255.0 * x / (size.width - 1)));
    // Lines of 1, 2, 4 and 8 pixels.
    const int width = 1 << (4 * x / size.width);
    image(cv::Rect(x, ramp_height, 1, size.height - ramp_height))
        .setTo(cv::Scalar::all((x / width) % 2 == 0 ? 235 : 16));
  }
  const cv::Point center(size.width / 2, size.height * 3 / 10);
  const int radius = std::max(4, size.height / 5);
  cv::circle(image, center, radius, {255, 255, 255}, std::max(1, size.height / 160), cv::LINE_AA);
  // A hand that turns once in a hundred frames shows that the picture moves.
  const double angle = 2 * CV_PI * static_cast<double>(frame % 100) / 100;
  cv::line(
      image, center,
      center + cv::Point(cvRound(radius * std::sin(angle)), cvRound(-radius * std::cos(angle))),
      {255, 255, 255}, std::max(1, size.height / 120), cv::LINE_AA);
  return image;
}

}  // namespace tarsier
