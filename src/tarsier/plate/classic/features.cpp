// SPDX-License-Identifier: MIT
#include "tarsier/plate/classic/features.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

namespace tarsier::plate {
namespace {

constexpr NameTable<PlateFeatures, 4> kFeatures{"features",
                                                {{{PlateFeatures::kPixels, "pixels"},
                                                  {PlateFeatures::kHog, "hog"},
                                                  {PlateFeatures::kPca, "pca"},
                                                  {PlateFeatures::kLbp, "lbp"}}}};

// Class of each 8-bit pattern: 58 patterns with at most two changes around the circle, and one
// class for the rest.
const std::array<std::uint8_t, 256>& uniform_classes() {
  static const std::array<std::uint8_t, 256> table = [] {
    std::array<std::uint8_t, 256> classes{};
    std::uint8_t next = 0;
    for (unsigned code = 0; code < 256; ++code) {
      const auto pattern = static_cast<std::uint8_t>(code);
      const int changes = std::popcount(static_cast<std::uint8_t>(pattern ^ std::rotl(pattern, 1)));
      classes[code] = changes <= 2 ? next++ : std::uint8_t{58};
    }
    return classes;
  }();
  return table;
}

}  // namespace

std::vector<float> projection_features(const cv::Mat& character, int thumbnail_size) {
  TARSIER_REQUIRE(character.type() == CV_8UC1 && character.cols == kCharacterSize &&
                      character.rows == kCharacterSize,
                  "a character of {}x{}, type {}", character.cols, character.rows,
                  character.type());
  TARSIER_REQUIRE(thumbnail_size >= 1 && thumbnail_size <= kCharacterSize, "{} px", thumbnail_size);
  std::vector<float> features(2 * kCharacterSize, 0.0F);
  for (int y = 0; y < kCharacterSize; ++y) {
    for (int x = 0; x < kCharacterSize; ++x) {
      if (character.at<std::uint8_t>(y, x) == 0) continue;
      features[static_cast<std::size_t>(x)] += 1;
      features[static_cast<std::size_t>(kCharacterSize + y)] += 1;
    }
  }
  for (const int start : {0, kCharacterSize}) {
    const auto first = features.begin() + start;
    const float max_count = *std::max_element(first, first + kCharacterSize);
    if (max_count > 0)
      std::for_each(first, first + kCharacterSize, [&](float& v) { v /= max_count; });
  }
  cv::Mat small;
  cv::resize(character, small, {thumbnail_size, thumbnail_size}, 0, 0, cv::INTER_LINEAR);
  for (int y = 0; y < thumbnail_size; ++y)
    for (int x = 0; x < thumbnail_size; ++x)
      features.push_back(static_cast<float>(small.at<std::uint8_t>(y, x)));
  return features;
}

std::vector<float> hog_features(const cv::Mat& gray, int cell, int bins) {
  TARSIER_REQUIRE(gray.type() == CV_8UC1 && gray.cols >= 2 * cell && gray.rows >= 2 * cell,
                  "an image of {}x{}, type {}", gray.cols, gray.rows, gray.type());
  const int across = gray.cols / cell;
  const int down = gray.rows / cell;
  std::vector<float> cells(static_cast<std::size_t>(across * down * bins), 0.0F);
  const auto add = [&](int cx, int cy, int bin, float value) {
    if (cx < 0 || cy < 0 || cx >= across || cy >= down) return;
    cells[static_cast<std::size_t>((cy * across + cx) * bins + bin)] += value;
  };
  for (int y = 0; y < down * cell; ++y) {
    for (int x = 0; x < across * cell; ++x) {
      const auto at = [&](int u, int v) {
        return static_cast<float>(gray.at<std::uint8_t>(std::clamp(v, 0, gray.rows - 1),
                                                        std::clamp(u, 0, gray.cols - 1)));
      };
      const float gx = at(x + 1, y) - at(x - 1, y);
      const float gy = at(x, y + 1) - at(x, y - 1);
      const float size = std::sqrt(gx * gx + gy * gy);
      if (size == 0) continue;
      float angle = std::atan2(gy, gx);
      if (angle < 0) angle += static_cast<float>(CV_PI);
      const float position = angle / static_cast<float>(CV_PI) * static_cast<float>(bins) - 0.5F;
      const int low = static_cast<int>(std::floor(position));
      const float share = position - static_cast<float>(low);
      const float px = (static_cast<float>(x) + 0.5F) / static_cast<float>(cell) - 0.5F;
      const float py = (static_cast<float>(y) + 0.5F) / static_cast<float>(cell) - 0.5F;
      const int cx = static_cast<int>(std::floor(px));
      const int cy = static_cast<int>(std::floor(py));
      const float wx = px - static_cast<float>(cx);
      const float wy = py - static_cast<float>(cy);
      for (const int b : {0, 1}) {
        const int bin = (low + b + bins) % bins;
        const float part = size * (b == 0 ? 1 - share : share);
        add(cx, cy, bin, part * (1 - wx) * (1 - wy));
        add(cx + 1, cy, bin, part * wx * (1 - wy));
        add(cx, cy + 1, bin, part * (1 - wx) * wy);
        add(cx + 1, cy + 1, bin, part * wx * wy);
      }
    }
  }
  std::vector<float> features;
  for (int cy = 0; cy + 1 < down; ++cy) {
    for (int cx = 0; cx + 1 < across; ++cx) {
      const std::size_t start = features.size();
      for (const auto& [u, v] :
           {std::pair{0, 0}, std::pair{1, 0}, std::pair{0, 1}, std::pair{1, 1}})
        for (int b = 0; b < bins; ++b)
          features.push_back(
              cells[static_cast<std::size_t>(((cy + v) * across + cx + u) * bins + b)]);
      const auto normalize = [&] {
        float squares = 1e-3F;
        for (std::size_t i = start; i < features.size(); ++i) squares += features[i] * features[i];
        const float scale = 1 / std::sqrt(squares);
        for (std::size_t i = start; i < features.size(); ++i) features[i] *= scale;
      };
      normalize();
      for (std::size_t i = start; i < features.size(); ++i)
        features[i] = std::min(features[i], 0.2F);
      normalize();
    }
  }
  return features;
}

std::vector<float> lbp_features(const cv::Mat& gray, int columns, int rows) {
  TARSIER_REQUIRE(gray.type() == CV_8UC1 && gray.cols >= columns + 2 && gray.rows >= rows + 2,
                  "an image of {}x{}, type {}", gray.cols, gray.rows, gray.type());
  constexpr int kPatterns = 59;
  std::vector<float> histogram(static_cast<std::size_t>(columns * rows * kPatterns), 0.0F);
  std::vector<float> totals(static_cast<std::size_t>(columns * rows), 0.0F);
  constexpr int kX[8] = {-1, 0, 1, 1, 1, 0, -1, -1};
  constexpr int kY[8] = {-1, -1, -1, 0, 1, 1, 1, 0};
  for (int y = 1; y + 1 < gray.rows; ++y) {
    for (int x = 1; x + 1 < gray.cols; ++x) {
      unsigned code = 0;
      for (unsigned k = 0; k < 8; ++k)
        code |=
            (gray.at<std::uint8_t>(y + kY[k], x + kX[k]) >= gray.at<std::uint8_t>(y, x) ? 1U : 0U)
            << k;
      const int part = (y * rows / gray.rows) * columns + x * columns / gray.cols;
      histogram[static_cast<std::size_t>(part * kPatterns + uniform_classes()[code])] += 1;
      totals[static_cast<std::size_t>(part)] += 1;
    }
  }
  for (std::size_t i = 0; i < histogram.size(); ++i)
    histogram[i] = std::sqrt(histogram[i] / std::max(1.0F, totals[i / kPatterns]));
  return histogram;
}

PlateFeatures parse_plate_features(std::string_view name) { return kFeatures.parse(name); }

std::string_view name_of(PlateFeatures features) { return kFeatures.name(features); }

std::vector<float> plate_features(const cv::Mat& candidate, PlateFeatures features) {
  TARSIER_REQUIRE(candidate.type() == CV_8UC1 && candidate.size() == kPlateSize,
                  "a candidate of {}x{}, type {}", candidate.cols, candidate.rows,
                  candidate.type());
  if (features == PlateFeatures::kHog) return hog_features(candidate, 8, 9);
  if (features == PlateFeatures::kLbp) return lbp_features(candidate, 8, 2);
  std::vector<float> values;
  values.reserve(candidate.total());
  for (int y = 0; y < candidate.rows; ++y)
    for (int x = 0; x < candidate.cols; ++x)
      values.push_back(static_cast<float>(candidate.at<std::uint8_t>(y, x)) / 255.0F - 0.5F);
  return values;
}

}  // namespace tarsier::plate
