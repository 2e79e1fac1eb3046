// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>

// The objects on the table of scene.h, and their intersection with rays.
namespace tarsier::synth::still_life {

// World: x right, y up, z away from the camera, about decimetres. The table is y = 0, the wall z =
// kWall.
struct Vec {
  float x = 0;
  float y = 0;
  float z = 0;
};
inline Vec operator+(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec operator-(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec operator*(Vec a, float s) { return {a.x * s, a.y * s, a.z * s}; }
inline Vec operator*(Vec a, Vec b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
inline float dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec cross(Vec a, Vec b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline float length(Vec a) { return std::sqrt(dot(a, a)); }
inline Vec unit(Vec a) { return a * (1 / length(a)); }
inline Vec mix(Vec a, Vec b, float t) { return a + (b - a) * t; }
inline float mix(float a, float b, float t) { return a + (b - a) * t; }
inline float smoothstep(float low, float high, float x) {
  const float t = std::clamp((x - low) / (high - low), 0.0F, 1.0F);
  return t * t * (3 - 2 * t);
}
// Converts sRGB, as in design tools, to linear light.
inline Vec srgb(int r, int g, int b) {
  const auto linear = [](int v) { return std::pow(static_cast<float>(v) / 255, 2.2F); };
  return {linear(r), linear(g), linear(b)};
}

// Random value in [0, 1) for each cell.
float hash(int x, int y, int z);
// Smooth noise in [0, 1] with features of size 1.
float noise(Vec p);
// A sum of octaves of noise; each has half the amplitude and twice the frequency of the one before.
float fractal_noise(Vec p, int octaves);

constexpr float kWall = 2.6F;
constexpr float kNoHit = 1e9F;

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
  float shade_radius = 0;  // range in which it darkens its neighbourhood
  // A kind with a distance function lies within `bound_radius` of its axis and between the heights
  // `low` and `high` above `base`.
  float bound_radius = 0;
  float low = 0;
  float high = 0;

  [[nodiscard]] bool is_sphere() const {
    return kind == Kind::kOrange || kind == Kind::kGrape || kind == Kind::kBall;
  }
  [[nodiscard]] Vec to_local(Vec p) const {
    const Vec q = p - base;
    return {turn_cos * q.x + turn_sin * q.z, q.y, -turn_sin * q.x + turn_cos * q.z};
  }
};

// Distance to the surface, or a slightly smaller value.
float distance_to(const Object& object, Vec world);

struct Ray {
  Vec from;
  Vec direction;
};

struct Hit {
  float t = kNoHit;
  const Object* object = nullptr;  // null: table or wall
  Kind kind = Kind::kPlaster;
  Vec normal;
};

// The part of the ray inside a sphere; false if the ray misses it.
inline bool cut_sphere(const Ray& ray, Vec center, float radius, float& enter, float& leave) {
  const Vec to = center - ray.from;
  const float along = dot(to, ray.direction);
  const float gap = dot(to, to) - along * along;
  if (gap > radius * radius) return false;
  const float half = std::sqrt(radius * radius - gap);
  enter = along - half;
  leave = along + half;
  return leave > 0;
}

// Limits [enter, leave] to the part of the ray inside the upright cylinder around the object.
bool cut_cylinder(const Object& object, const Ray& ray, float& enter, float& leave);

// Updates `hit` if the ray meets the object earlier.
void intersect(const Object& object, const Ray& ray, Hit& hit);

}  // namespace tarsier::synth::still_life
