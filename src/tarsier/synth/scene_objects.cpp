// SPDX-License-Identifier: MIT
#include "tarsier/synth/scene_objects.h"

#include <cstdint>

namespace tarsier::synth::still_life {
namespace {

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
  const float lip = 0.10F * smoothstep(1.2F, 1.5F, y);
  const float foot = 0.09F * (1 - smoothstep(0.0F, 0.16F, y));
  return 0.13F + belly + lip + foot;
}

Vec distance_normal(const Object& object, Vec p) {
  constexpr float e = 0.0015F;
  const float a = distance_to(object, p + Vec{e, -e, -e});
  const float b = distance_to(object, p + Vec{-e, -e, e});
  const float c = distance_to(object, p + Vec{-e, e, -e});
  const float d = distance_to(object, p + Vec{e, e, e});
  return unit({a - b - c + d, -a - b + c + d, -a + b - c + d});
}

}  // namespace

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

float noise(Vec p) {
  const auto floor_of = [](float v) {  // std::floor is a library call without SSE4.1
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

float fractal_noise(Vec p, int octaves) {
  float sum = 0;
  float weight = 0.5F;
  for (int i = 0; i < octaves; ++i) {
    sum += weight * noise(p);
    p = p * 2.03F + Vec{17.1F, 3.7F, 9.2F};
    weight *= 0.5F;
  }
  return sum;
}

float distance_to(const Object& object, Vec world) {
  const Vec p = object.to_local(world);
  switch (object.kind) {
    case Kind::kApple: {  // radius 0.5, its centre 0.46 above the table
      const Vec q{p.x, p.y - 0.46F, p.z};
      const float around = q.x * q.x + q.z * q.z;
      // Both ends fade out before they meet.
      const float dimple = around > 0.2F ? 0 : (q.y > 0 ? 0.13F : 0.07F) * std::exp(-around * 26);
      const float taper = 0.05F * (0.46F - q.y) * smoothstep(0.0F, 0.6F, 0.46F - q.y);
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
      return kNoHit;
  }
}

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
  const float c = from.x * from.x + from.z * from.z - object.bound_radius * object.bound_radius;
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
    // An ellipsoid is a unit sphere in coordinates scaled by its half axes.
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

}  // namespace tarsier::synth::still_life
