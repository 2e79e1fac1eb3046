// SPDX-License-Identifier: MIT
#include "tarsier/synth/portrait.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <array>
#include <cmath>

namespace tarsier::synth {
namespace {

// Face coordinates: unit = height of the image, origin at the centre of the face, x right, y down.
// The face is an ellipse 0.70 high and 0.504 wide.
using Color = cv::Vec3f;  // BGR, 0..1, as displayed

constexpr float kHalfWidth = 0.236F;
constexpr float kHalfHeight = 0.35F;
constexpr float kEyeX = 0.093F;
constexpr float kEyeY = -0.045F;
constexpr float kMouthY = 0.178F;
constexpr float kMouthHalf = 0.088F;

float smoothstep(float low, float high, float x) {
  const float t = std::clamp((x - low) / (high - low), 0.0F, 1.0F);
  return t * t * (3 - 2 * t);
}
// 1 inside (distance < 0), 0 outside, with an edge of width `soft`.
float inside(float distance, float soft) { return 1 - smoothstep(-soft, soft, distance); }
float bell(float x, float y, float wide, float high) {
  const float squares = (x * x) / (wide * wide) + (y * y) / (high * high);
  return squares > 12 ? 0 : std::exp(-squares);  // below 1e-5 beyond this
}
Color mix(const Color& a, const Color& b, float t) { return a + (b - a) * t; }
Color rgb(int r, int g, int b) {
  return {static_cast<float>(b) / 255, static_cast<float>(g) / 255, static_cast<float>(r) / 255};
}

float hash(int x, int y) {
  std::uint32_t h =
      static_cast<std::uint32_t>(x) * 0x8da6b343U ^ static_cast<std::uint32_t>(y) * 0xd8163841U;
  h ^= h >> 15U;
  h *= 0x2c1b3c6dU;
  h ^= h >> 12U;
  h *= 0x297a2d39U;
  h ^= h >> 15U;
  return static_cast<float>(h & 0xffffffU) * (1.0F / 16777216.0F);
}
float noise(float x, float y) {
  const auto floor_of = [](float v) {  // std::floor is a call without SSE4.1
    const int i = static_cast<int>(v);
    return i - static_cast<int>(static_cast<float>(i) > v);
  };
  const int ix = floor_of(x);
  const int iy = floor_of(y);
  const auto fx = static_cast<float>(ix);
  const auto fy = static_cast<float>(iy);
  const auto fade = [](float t) { return t * t * (3 - 2 * t); };
  const float u = fade(x - fx);
  const float v = fade(y - fy);
  const float a = hash(ix, iy) + (hash(ix + 1, iy) - hash(ix, iy)) * u;
  const float b = hash(ix, iy + 1) + (hash(ix + 1, iy + 1) - hash(ix, iy + 1)) * u;
  return a + (b - a) * v;
}

// Approximate distance to an ellipse; negative inside.
float ellipse(float x, float y, float wide, float high) {
  const float k = std::sqrt(x * x / (wide * wide) + y * y / (high * high));
  const float g =
      std::sqrt(x * x / (wide * wide * wide * wide) + y * y / (high * high * high * high));
  return g > 1e-6F ? k * (k - 1) / g : -std::min(wide, high);
}

float segment(float x, float y, float ax, float ay, float bx, float by) {
  const float px = x - ax;
  const float py = y - ay;
  const float dx = bx - ax;
  const float dy = by - ay;
  const float h = std::clamp((px * dx + py * dy) / (dx * dx + dy * dy), 0.0F, 1.0F);
  return std::hypot(px - dx * h, py - dy * h);
}

// The outline: an egg shape, wider above, with a chin.
float face_outline(float x, float y) {
  const float narrower =
      1 - 0.20F * smoothstep(0.02F, 0.35F, y) - 0.03F * smoothstep(-0.1F, -0.35F, y);
  return ellipse(x / narrower, y, kHalfWidth, kHalfHeight) * 0.9F;
}

struct Palette {
  Color skin;
  Color hair;
  Color iris;
  Color lips;
  Color shirt;
  Color wall;
};

Palette choose_palette(std::uint64_t seed) {
  static const std::array<Color, 5> kSkins = {rgb(226, 172, 140), rgb(238, 192, 164),
                                              rgb(198, 140, 104), rgb(160, 106, 76),
                                              rgb(120, 78, 56)};
  static const std::array<Color, 5> kHairs = {rgb(74, 46, 28), rgb(36, 28, 26), rgb(150, 104, 52),
                                              rgb(104, 44, 22), rgb(120, 114, 110)};
  static const std::array<Color, 4> kIrises = {rgb(72, 112, 132), rgb(92, 62, 34), rgb(84, 110, 66),
                                               rgb(60, 42, 30)};
  static const std::array<Color, 5> kShirts = {rgb(44, 82, 122), rgb(120, 44, 52), rgb(62, 96, 70),
                                               rgb(90, 84, 120), rgb(190, 178, 150)};
  static const std::array<Color, 5> kWalls = {rgb(136, 160, 166), rgb(150, 154, 138),
                                              rgb(120, 134, 160), rgb(158, 166, 174),
                                              rgb(110, 132, 122)};
  Rng rng(seed);
  const auto pick = [&](const auto& colors) {
    const int index = rng.integer(0, static_cast<int>(colors.size()) - 1);
    return colors[seed == 1 ? 0 : static_cast<std::size_t>(index)];
  };
  Palette palette;
  palette.skin = pick(kSkins);
  palette.hair = pick(kHairs);
  palette.iris = pick(kIrises);
  palette.shirt = pick(kShirts);
  palette.wall = pick(kWalls);
  palette.lips = mix(palette.skin, rgb(176, 52, 62), 0.55F);
  return palette;
}

struct Sample {
  Color color;
  float skin = 0;  // share of visible skin
};

class Painter {
 public:
  Painter(std::uint64_t seed, float pixel, float blink)
      : palette_(choose_palette(seed)), pixel_(pixel), blink_(blink) {}

  // (x, y) in face coordinates of the moving head; (bx, by) in those of the image.
  [[nodiscard]] Sample at(float x, float y, float bx, float by) const;

 private:
  void paint_body(Sample& s, float x, float y) const;
  // `outline`: face_outline(x, y); `face`: covered share of the pixel.
  void paint_head(Sample& s, float x, float y, float outline, float face) const;
  void paint_eye(Sample& s, float x, float y, float side) const;
  void paint_hair(Sample& s, float x, float y, bool behind) const;
  void cover(Sample& s, const Color& color, float amount) const {
    s.color = mix(s.color, color, amount);
    s.skin *= 1 - amount;
  }
  // Light from the upper left on a surface with this slope.
  static float shade(float slope_x, float slope_y) {
    return std::clamp(0.93F - 0.30F * slope_x - 0.25F * slope_y, 0.25F, 1.15F);
  }

  Palette palette_;
  float pixel_;  // size of a pixel; edges are about one pixel wide
  float blink_;  // 0: eyes open
};

void Painter::paint_body(Sample& s, float x, float y) const {
  if (y <= 0.2F) return;
  // Neck, with the shadow of the chin.
  const float neck = std::max(std::abs(x) - 0.118F - 0.25F * std::max(0.0F, y - 0.42F), 0.2F - y);
  const float neck_in = inside(neck, pixel_);
  if (neck_in > 0) {
    const float under = 1 - 0.45F * smoothstep(0.47F, 0.34F, y);
    const Color tone = palette_.skin * (under * shade(x * 4.5F, 0.35F));
    s.color = mix(s.color, tone, neck_in);
    s.skin = s.skin * (1 - neck_in) + neck_in;
  }
  // Shoulders and a round neckline.
  const float beside = std::max(0.0F, std::abs(x) - 0.12F);
  const float shoulder = 0.405F + 0.13F * beside + 0.42F * beside * beside;
  const float body = std::max(shoulder - y, -ellipse(x, y - 0.385F, 0.15F, 0.070F));
  const float body_in = inside(body, pixel_);
  if (body_in > 0) {
    const float fold = noise(x * 9 + 3, y * 5) - 0.5F;
    const float knit = noise(x * 130, y * 260) - 0.5F;
    Color cloth = palette_.shirt * (shade(x * 1.3F, -0.1F) + 0.24F * fold + 0.10F * knit);
    const float collar =
        inside(std::abs(body + 0.012F) - 0.006F, pixel_) * inside(std::abs(x) - 0.17F, 0.02F);
    cloth = mix(cloth, palette_.shirt * 0.55F, collar * 0.7F);
    cover(s, cloth, body_in);
  }
}

// Behind the head a cap; in front the hair with a wavy hairline.
void Painter::paint_hair(Sample& s, float x, float y, bool behind) const {
  // Pixels that the hair cannot reach with any `wave` (-0.5 to 0.5) need no noise.
  if (behind) {
    if (y - 0.125F > pixel_ + 0.003F || ellipse(x, y + 0.075F, 0.278F, 0.342F) > pixel_ + 0.003F)
      return;
  } else {
    const float aside = std::max(0.0F, std::abs(x) - 0.13F);
    if (y + 0.227F - 13.5F * aside * aside > pixel_ + 0.004F ||
        ellipse(x, y + 0.075F, 0.27F, 0.332F) > pixel_ + 0.004F)
      return;
  }
  const float wave = noise(x * 16 + y * 4, y * 5) - 0.5F;
  float amount = 0;
  if (behind) {
    const float cap = ellipse(x, y + 0.075F, 0.272F + 0.010F * wave, 0.335F + 0.012F * wave);
    amount = inside(std::max(cap, y - 0.10F - 0.05F * wave), pixel_ + 0.003F);
  } else {
    // From the parting on the right the hair runs to both sides; temples are covered.
    const float line =
        -0.262F + 0.05F * smoothstep(0.06F, -0.2F, x) * 0.6F +
        1.5F * std::max(0.0F, std::abs(x) - 0.13F) * std::max(0.0F, std::abs(x) - 0.13F) * 9.0F +
        0.010F * wave;
    const float front = std::max(y - line, ellipse(x, y + 0.075F, 0.27F, 0.332F));
    amount = inside(front, pixel_ + 0.004F);
  }
  if (amount <= 0) return;
  const float strand = noise(x * 90 + 20 * noise(x * 6, y * 6), y * 9) - 0.5F;
  const float dome =
      std::clamp(1 - (x + 0.07F) * (x + 0.07F) * 14 - (y + 0.30F) * (y + 0.30F) * 22, 0.0F, 1.0F);
  const float light = (behind ? 0.55F : 0.78F) + 0.55F * dome * (0.55F + 0.9F * strand) +
                      0.45F * strand + 0.2F * wave;
  cover(s, palette_.hair * std::max(light, 0.25F), amount);
}

void Painter::paint_eye(Sample& s, float x, float y, float side) const {
  // In the eye's own frame: u towards the temple.
  const float u = (x - side * kEyeX) * side;
  const float v = y - kEyeY;
  if (std::abs(u) > 0.085F || v < -0.12F || v > 0.08F) return;
  // Shading of the socket, the lid below it and the crease above.
  const float socket = bell(u + 0.012F, v + 0.012F, 0.062F, 0.040F);
  s.color *= 1 - 0.20F * socket;
  const float open = 1 - blink_;
  const float span = std::clamp(1 - (u / 0.047F) * (u / 0.047F), 0.0F, 1.0F);
  const float tilt = -0.06F * u;
  const float upper = tilt - 0.0215F * std::sqrt(span) * open - 0.001F;
  const float lower = tilt + 0.0155F * span * (0.4F + 0.6F * open) + 0.001F;
  const float crease = upper - 0.013F;
  s.color *= 1 - 0.30F * inside(std::abs(v - crease) - 0.0016F, pixel_ + 0.0016F) *
                     smoothstep(0.062F, 0.03F, std::abs(u));
  const float eyeball = inside(std::max({std::abs(u) - 0.047F, upper - v, v - lower}), pixel_);
  if (eyeball > 0) {
    const float round = u * u / (0.05F * 0.05F);
    Color ball =
        rgb(238, 234, 230) * (1.0F - 0.22F * round - 0.30F * inside(v - upper - 0.010F, 0.007F));
    const float d = std::hypot(u * side + 0.002F, v + 0.003F);
    const float angle = std::atan2(v + 0.003F, u + 0.002F);
    const float rays = 0.75F + 0.45F * noise(angle * 6 + 40, d * 120);
    const float iris = inside(d - 0.0215F, pixel_);
    ball =
        mix(ball, palette_.iris * rays * (1.15F - 0.3F * inside(v - upper - 0.012F, 0.008F)), iris);
    ball = mix(ball, palette_.iris * 0.3F, iris * smoothstep(0.0175F, 0.0215F, d));
    ball = mix(ball, rgb(14, 12, 12), inside(d - 0.0095F, pixel_));
    ball = mix(ball, rgb(255, 255, 255),
               inside(std::hypot(u * side + 0.009F, v + 0.011F) - 0.0045F, pixel_));
    const float corner = inside(std::hypot(u + 0.045F, v - tilt) - 0.008F, 0.005F);
    ball = mix(ball, rgb(206, 140, 128), 0.7F * corner);
    cover(s, ball, eyeball);
  }
  // Lashes above, a finer line below.
  const float within = smoothstep(0.054F, 0.044F, std::abs(u));
  cover(s, rgb(38, 26, 22),
        0.92F * within *
            inside(std::abs(v - upper) - 0.0028F - 0.03F * std::max(u, 0.0F) * 0.05F, pixel_));
  cover(s, palette_.skin * 0.55F,
        0.5F * within * inside(std::abs(v - lower) - 0.0010F, pixel_ + 0.0008F));
  // The brow: an arch of hairs, thinner towards the temple.
  const float arch = -0.064F - 0.016F * (1 - (u - 0.012F) * (u - 0.012F) / 0.0028F);
  const float thick = 0.0105F - 0.05F * std::max(0.0F, u) - 0.04F * std::max(0.0F, -u - 0.03F);
  const float hairs = noise(u * 260 + v * 130, v * 120 - u * 60);
  const float brow =
      inside(std::max(std::abs(v - arch) - thick, std::abs(u - 0.003F) - 0.066F), 0.004F + pixel_);
  cover(s, palette_.hair * 0.75F, brow * (0.55F + 0.45F * hairs));
}

void Painter::paint_head(Sample& s, float x, float y, float outline, float face) const {
  // Ears.
  for (const float side : {-1.0F, 1.0F}) {
    const float u = x * side - 0.236F;
    const float v = y - 0.02F;
    if (std::abs(u) > 0.05F + 2 * pixel_ || std::abs(v) > 0.09F + 2 * pixel_) continue;
    const float ear = inside(ellipse(u, v, 0.036F, 0.074F), pixel_);
    if (ear <= 0) continue;
    const float rim = inside(std::abs(ellipse(u - 0.004F, v, 0.020F, 0.050F)) - 0.004F, 0.004F);
    const Color tone =
        mix(palette_.skin, rgb(190, 96, 84), 0.22F) * (shade(0.55F * side, 0) * (1 - 0.25F * rim));
    s.color = mix(s.color, tone, ear);
    s.skin = s.skin * (1 - ear) + ear;
  }
  if (face <= 0) return;

  // Slopes of the egg-shaped head, plus those of nose, cheeks, brow and chin: height fields of bell
  // functions.
  float slope_x = 0;
  float slope_y = 0;
  const float nx = x / (kHalfWidth * 1.06F);
  const float ny = y / (kHalfHeight * 1.10F);
  const float depth = std::sqrt(std::max(0.05F, 1 - nx * nx - ny * ny));
  slope_x += 0.62F * nx / depth;
  slope_y += 0.42F * ny / depth;
  const auto bump = [&](float cx, float cy, float wide, float high, float strength) {
    const float b = strength * bell(x - cx, y - cy, wide, high);
    slope_x += b * (x - cx) / wide;
    slope_y += b * (y - cy) / high;
  };
  bump(0, 0.008F, 0.030F, 0.085F, 0.95F);  // ridge of the nose
  bump(0, 0.085F, 0.036F, 0.030F, 1.15F);  // its tip
  bump(-0.033F, 0.094F, 0.018F, 0.018F, 0.7F);
  bump(0.033F, 0.094F, 0.018F, 0.018F, 0.7F);
  bump(-0.120F, 0.075F, 0.065F, 0.060F, 0.42F);  // cheeks
  bump(0.120F, 0.075F, 0.065F, 0.060F, 0.42F);
  bump(0, 0.285F, 0.055F, 0.040F, 0.42F);   // chin
  bump(0, 0.148F, 0.014F, 0.024F, -0.35F);  // philtrum
  bump(0, -0.20F, 0.16F, 0.08F, 0.18F);     // forehead
  float light = shade(slope_x, slope_y);
  // Shadows: below nose, lip and hair, and beside the root of the nose.
  light *= 1 - 0.34F * bell(x, y - 0.118F, 0.045F, 0.012F);
  light *= 1 - 0.22F * bell(x, y - 0.232F, 0.060F, 0.014F);
  light *= 1 - 0.28F * inside(y + 0.235F, 0.035F);
  light *= 1 - 0.12F * (bell(x - 0.035F, y + 0.04F, 0.016F, 0.035F) +
                        bell(x + 0.035F, y + 0.04F, 0.016F, 0.035F));
  light *= 1 - 0.30F * smoothstep(-0.030F, 0.0F, outline);
  // Skin is not uniform: red cheeks and nose, and fine grain.
  Color tone = mix(palette_.skin, rgb(214, 104, 92),
                   0.20F * (bell(x - 0.125F, y - 0.085F, 0.06F, 0.045F) +
                            bell(x + 0.125F, y - 0.085F, 0.06F, 0.045F)) +
                       0.16F * bell(x, y - 0.09F, 0.04F, 0.03F));
  light += 0.03F * (noise(x * 50, y * 50) - 0.5F) + 0.035F * (noise(x * 210, y * 210) - 0.5F);
  tone *= light;
  tone += Color(0.16F, 0.17F, 0.18F) * (0.75F * bell(x + 0.010F, y - 0.070F, 0.010F, 0.018F) +
                                        0.30F * bell(x + 0.055F, y + 0.20F, 0.07F, 0.05F) +
                                        0.30F * bell(x + 0.125F, y - 0.045F, 0.030F, 0.024F));
  s.color = mix(s.color, tone, face);
  s.skin = s.skin * (1 - face) + face;

  // Nostrils.
  for (const float side : {-1.0F, 1.0F}) {
    if (std::abs(y - 0.10F) > 0.08F + 2 * pixel_) break;
    const float nostril =
        inside(ellipse(x - side * 0.0185F, y - 0.1115F - 0.15F * std::abs(x - side * 0.0185F),
                       0.0105F, 0.0052F),
               0.0025F + pixel_);
    cover(s, palette_.skin * 0.28F, 0.85F * nostril);
    const float wing = std::abs(std::hypot(x - side * 0.036F, y - 0.094F) - 0.0165F);
    const float behind_wing = smoothstep(0.030F, 0.046F, x * side) * smoothstep(0.070F, 0.085F, y);
    s.color *= 1 - 0.28F * behind_wing * inside(wing - 0.0015F, 0.004F) *
                       inside(std::abs(y - 0.094F) - 0.018F, 0.01F);
  }
  // A smile: the corners are higher than the centre.
  const float m = x / kMouthHalf;
  if (std::abs(m) < 1.25F && std::abs(y - kMouthY) < 0.12F + pixel_) {
    const float curve = kMouthY - 0.017F * m * m;
    const float v = y - curve;
    const float span = std::clamp(1 - m * m, 0.0F, 1.0F);
    const float bow = 0.0175F * std::pow(span, 0.7F) - 0.006F * bell(x, 0, 0.012F, 1);
    const float full = 0.0255F * std::pow(span, 0.6F);
    const float lips = inside(std::max({-v - bow, v - full, std::abs(m) * kMouthHalf - kMouthHalf}),
                              0.0016F + pixel_);
    if (lips > 0 && span > 0) {
      const float roll = v < 0 ? 0.72F + 8 * v : 1.02F - 14 * std::abs(v - 0.011F);
      Color lip = palette_.lips * (roll * (0.9F + 0.2F * noise(x * 160, y * 30)));
      lip += Color(0.20F, 0.20F, 0.22F) * (0.8F * bell(x + 0.02F, v - 0.010F, 0.030F, 0.005F));
      cover(s, lip, lips);
    }
    const float parting = inside(std::abs(v) - 0.0022F * (0.4F + span), pixel_ + 0.0008F) *
                          smoothstep(1.06F, 0.98F, std::abs(m));
    cover(s, rgb(84, 26, 28), 0.85F * parting);
    const float dimple = bell(std::abs(x) - kMouthHalf - 0.006F, v + 0.002F, 0.010F, 0.014F);
    s.color *= 1 - 0.22F * dimple;
  }
  // Lines from the wings of the nose to the mouth.
  const float fold = segment(std::abs(x), y, 0.056F, 0.100F, 0.100F, 0.150F);
  s.color *= 1 - 0.10F * inside(fold - 0.002F, 0.008F);
  paint_eye(s, x, y, -1);
  paint_eye(s, x, y, 1);
}

Sample Painter::at(float x, float y, float bx, float by) const {
  Sample s;
  // Far from the face its outline is not computed.
  const bool is_near = std::abs(x) < 0.3F && std::abs(y) < 0.42F;
  const float outline = is_near ? face_outline(x, y) : 1;
  const float face = is_near ? inside(outline, pixel_) : 0;
  if (face < 1) {  // otherwise the face hides it
    // An out-of-focus wall, lit from the left.
    const float glow = bell(bx + 0.45F, by + 0.25F, 0.8F, 0.7F);
    const float spots = noise(bx * 3 + 5, by * 3 + 9);
    s.color = palette_.wall * (0.62F + 0.42F * glow + 0.10F * (spots - 0.5F));
    paint_hair(s, x, y, true);
    paint_body(s, 0.25F * x + 0.75F * bx, 0.25F * y + 0.75F * by);
  }
  paint_head(s, x, y, outline, face);
  paint_hair(s, x, y, false);
  return s;
}

}  // namespace

Portrait render_portrait(cv::Size size, double time_s, std::uint64_t seed) {
  TARSIER_REQUIRE(
      size.width >= 16 && size.height >= 16 && size.width <= 16384 && size.height <= 16384,
      "{}x{} px", size.width, size.height);
  TARSIER_REQUIRE(std::isfinite(time_s), "time {}", time_s);
  // In narrow images the width limits the size.
  const double unit = std::min<double>(size.height, size.width / 0.62);
  const double shift_x = 0.014 * std::sin(0.9 * time_s);
  const double shift_y = 0.008 * std::sin(1.3 * time_s);
  const double tilt = 0.025 * std::sin(0.7 * time_s);
  const double phase =
      std::fmod(std::abs(time_s), 4.0);  // the eyes close briefly every four seconds
  const double blink = phase > 3.7 && phase < 3.95 ? std::sin((phase - 3.7) / 0.25 * CV_PI) : 0;
  const double c = std::cos(tilt);
  const double s = std::sin(tilt);

  Portrait portrait;
  portrait.image.create(size, CV_8UC3);
  portrait.skin_mask.create(size, CV_8UC1);
  const double per_pixel = 1 / unit;
  const Painter painter(seed, static_cast<float>(0.75 / unit), static_cast<float>(blink));
  cv::parallel_for_(cv::Range(0, size.height), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      auto* pixels = portrait.image.ptr<cv::Vec3b>(y);
      auto* mask = portrait.skin_mask.ptr<std::uint8_t>(y);
      const double by = (y - 0.5 * (size.height - 1)) * per_pixel;
      for (int x = 0; x < size.width; ++x) {
        const double bx = (x - 0.5 * (size.width - 1)) * per_pixel;
        const double dx = bx - shift_x;
        const double dy = by - shift_y;
        const Sample sample =
            painter.at(static_cast<float>(c * dx + s * dy), static_cast<float>(-s * dx + c * dy),
                       static_cast<float>(bx), static_cast<float>(by));
        for (int k = 0; k < 3; ++k) {
          pixels[x][k] = cv::saturate_cast<std::uint8_t>(255 * sample.color[k]);
        }
        mask[x] = sample.skin > 0.5F ? 255 : 0;
      }
    }
  });

  const auto place = [&](double x, double y) {
    return cv::Point2d(0.5 * (size.width - 1) + unit * (c * x - s * y + shift_x),
                       0.5 * (size.height - 1) + unit * (s * x + c * y + shift_y));
  };
  const cv::Point2d middle = place(0, 0);
  const double half_width = unit * static_cast<double>(kHalfWidth);
  const double half_height = unit * static_cast<double>(kHalfHeight);
  portrait.truth.box = {middle.x - half_width, middle.y - half_height, 2 * half_width,
                        2 * half_height};
  // The irises are slightly inwards of the lids' centres (see paint_eye).
  portrait.truth.eyes[0] =
      place(-static_cast<double>(kEyeX) - 0.002, static_cast<double>(kEyeY) - 0.003);
  portrait.truth.eyes[1] =
      place(static_cast<double>(kEyeX) - 0.002, static_cast<double>(kEyeY) - 0.003);
  portrait.truth.nose = place(0, 0.085);
  portrait.truth.mouth[0] =
      place(-static_cast<double>(kMouthHalf), static_cast<double>(kMouthY) - 0.017);
  portrait.truth.mouth[1] =
      place(static_cast<double>(kMouthHalf), static_cast<double>(kMouthY) - 0.017);
  return portrait;
}

}  // namespace tarsier::synth
