// SPDX-License-Identifier: MIT
#include "tarsier/synth/scene_world.h"

namespace tarsier::synth::still_life {
namespace {

// Colours of objects.
const Vec kStraw = srgb(226, 158, 58);
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

}  // namespace

Surface Scene::surface(const Hit& hit, Vec p, Vec& normal) const {
  Surface s;
  const Object* object = hit.object;
  const Vec local = object != nullptr ? object->to_local(p) : p;
  const auto bump = [&](Vec at, float scale, float height) {
    const float n = noise(at * scale);
    constexpr float e = 0.35F;
    const Vec slope{noise(at * scale + Vec{e, 0, 0}) - n, noise(at * scale + Vec{0, e, 0}) - n,
                    noise(at * scale + Vec{0, 0, e}) - n};
    normal = unit(normal - slope * height);
  };
  switch (hit.kind) {
    case Kind::kPlaster: {
      s.color = wall_ * (0.88F + 0.24F * fractal_noise(p * 1.3F, 3));
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
      const float warp = fractal_noise(q, 3);
      const float rings = 0.5F + 0.5F * std::sin((p.z * 9 + warp * 13 + q.x * 0.6F) * 2.2F);
      const float fibre = noise({p.x * 7, static_cast<float>(number), p.z * 110});
      const float light = 0.72F + 0.30F * rings * (0.4F + warp) + 0.22F * (fibre - 0.5F) +
                          0.25F * (hash(number, 8, 3) - 0.5F);
      s.color = mix(wood_ * 0.55F, wood_ * 1.15F, std::clamp(light, 0.0F, 1.0F));
      const float gap = std::min(across, 1 - across);
      s.color = s.color * mix(0.25F, 1, smoothstep(0.004F, 0.022F, gap));
      s.gloss = 0.035F;
      s.focus = 0.15F;
      break;
    }
    case Kind::kOrange: {
      const Vec q = (p - object->center) * (1 / object->radius);
      s.color = object->color * (0.85F + 0.3F * fractal_noise(q * 3, 2));
      bump(q, 22, 0.30F);
      const float navel = smoothstep(0.90F, 0.985F, dot(unit(q), unit(Vec{0.45F, 0.75F, -0.5F})));
      s.color = mix(s.color, kNavel, navel * 0.8F);
      s.gloss = 0.04F;
      s.focus = 0.25F;
      break;
    }
    case Kind::kGrape: {
      const Vec q = (p - object->center) * (1 / object->radius);
      const float bloom = fractal_noise(q * 2.5F + object->center * 5, 3);
      s.color = mix(object->color, kBloom, 0.35F * smoothstep(0.35F, 0.75F, bloom));
      s.gloss = 0.045F;
      s.focus = 0.75F;
      break;
    }
    case Kind::kBall: {
      const Vec q = local * (1 / object->radius);
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
      const float vein = 1 - smoothstep(0.03F, 0.09F, std::abs(across));
      const float ribs = 0.5F + 0.5F * std::sin((along * 9 + std::abs(across) * 4) * 3);
      s.color = mix(object->color * (0.8F + 0.25F * ribs), kVein, 0.6F * vein);
      s.gloss = 0.03F;
      s.focus = 0.2F;
      break;
    }
    case Kind::kApple: {
      const Vec q{local.x, local.y - 0.46F, local.z};
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
          smoothstep(0.12F, 0.62F, streak * 0.6F + fine * 0.4F + 0.22F * std::sin(turn + 1.4F));
      s.color = mix(kStraw, object->color, 0.45F + 0.55F * blush);
      s.color = mix(kHollow, s.color, smoothstep(0.03F, 0.26F, around));
      const float speckle = noise(q * 38);
      s.color = mix(s.color, kSpeckle, 0.7F * smoothstep(0.84F, 0.92F, speckle));
      s.gloss = 0.045F;
      s.focus = 0.8F;
      break;
    }
    case Kind::kPear: {
      if (local.y > 1.11F) {
        s.color = kPearStem;
        break;
      }
      const float patch = fractal_noise(local * 2.4F, 3);
      s.color = mix(object->color, kRusset, smoothstep(0.42F, 0.75F, patch + 0.18F * local.x));
      const float speckle = noise(local * 30);
      s.color = s.color * mix(1.0F, 0.55F, smoothstep(0.76F, 0.9F, speckle));
      s.gloss = 0.035F;
      s.focus = 0.3F;
      break;
    }
    case Kind::kVase: {
      s.color = object->color;
      const Vec blue = kCobalt;
      const float turn = std::atan2(local.z, local.x);
      const auto band = [&](float middle, float half) {
        return 1 - smoothstep(half - 0.006F, half + 0.006F, std::abs(local.y - middle));
      };
      const float wave = 0.55F + 0.13F * std::sin(turn * 7);
      const float petals = 1 - smoothstep(0.0F, 0.25F,
                                          std::abs(std::sin(turn * 3.5F)) -
                                              0.8F * (1 - std::abs(local.y - 0.55F) / 0.26F));
      const float inside_belt = 1 - smoothstep(0.26F, 0.28F, std::abs(local.y - 0.55F));
      const float paint = std::max({band(0.88F, 0.018F), band(0.22F, 0.018F), band(0.94F, 0.007F),
                                    band(0.17F, 0.007F), band(1.46F, 0.02F),
                                    1 - smoothstep(0.015F, 0.028F, std::abs(local.y - wave)),
                                    petals * inside_belt * 0.85F});
      s.color = mix(s.color, blue, paint * (0.75F + 0.25F * noise(local * 16)));
      s.gloss = 0.06F;
      s.focus = 1;
      break;
    }
    case Kind::kMug: {
      const float around = std::sqrt(local.x * local.x + local.z * local.z);
      const bool is_inside = around < 0.37F && local.y < 0.87F && local.y > 0.5F;
      s.color = is_inside ? (local.y < 0.73F ? kCoffee : kGlaze) : object->color;
      if (!is_inside && around < 0.43F && local.y > 0.3F && local.y < 0.62F) {
        const float zig =
            0.46F +
            0.07F * (std::abs(std::fmod(std::atan2(local.z, local.x) * 5 + 40, 2.0F) - 1) - 0.5F) *
                2;
        s.color = mix(kSlip, s.color, smoothstep(0.022F, 0.034F, std::abs(local.y - zig)));
      }
      s.gloss = is_inside ? 0.02F : 0.055F;
      s.focus = 0.9F;
      break;
    }
    case Kind::kBook: {
      const bool is_edge = std::abs(local.y) < object->height - 0.035F &&
                           (local.x > 0.70F || std::abs(local.z) > 0.49F) && local.x > -0.66F;
      if (is_edge) {
        const float leaf = noise({local.x * 2, local.y * 260, local.z * 2});
        s.color = mix(kPaperDark, kPaper, leaf);
        break;
      }
      const float weave = noise({local.x * 120, local.y * 120, local.z * 120});
      s.color = object->color * (0.8F + 0.35F * weave);
      const bool is_spine = local.x < -0.69F;
      const bool is_gold = is_spine ? std::abs(std::abs(local.z) - 0.3F) < 0.012F ||
                                          (std::abs(local.z) < 0.14F && std::abs(local.y) < 0.02F)
                                    : std::abs(std::abs(local.x) - 0.6F) < 0.008F ||
                                          std::abs(std::abs(local.z) - 0.42F) < 0.008F;
      if (is_gold) s.color = kGold;
      s.gloss = 0.02F;
      s.focus = 0.1F;
      break;
    }
  }
  return s;
}

}  // namespace tarsier::synth::still_life
