// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/synth/street.h"

#include <opencv2/core.hpp>

#include <vector>

namespace tarsier::synth {

// A flat image of a car from the front or behind, as an image pyramid.
struct CarSprite {
  // BGR and coverage, each level half as large as the one before; the first is kSpriteWidth wide.
  std::vector<cv::Mat> color;
  std::vector<cv::Mat> alpha;
  std::string text;
  cv::Rect2f plate;               // px of the first level
  std::vector<cv::Rect2f> lamps;  // lamps that are lit at night
  bool rear = true;
};

inline constexpr int kSpriteWidth = 760;
inline constexpr int kSpriteHeight = 640;   // with the shadow below the wheels
inline constexpr double kCarMetres = 1.85;  // width of the body
inline constexpr int kBodyWidth = 700;      // px of the first level

[[nodiscard]] CarSprite draw_car(const GlyphSet& glyphs, StreetLight light, PlateKind kind,
                                 const std::string& text, Rng& rng, bool wild = false);

}  // namespace tarsier::synth
