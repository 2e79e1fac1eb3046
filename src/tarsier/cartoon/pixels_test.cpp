// SPDX-License-Identifier: MIT
// Every mode draws the same pixels on every processor. The test compares all instruction sets of
// this processor. The fixed checksums below compare x86-64 and arm64.
#include "tarsier/cartoon/cartoonize.h"
#include "tarsier/cartoon/kernels.h"
#include "tarsier/core/cpu.h"
#include "tarsier/core/rng.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <cstdint>
#include <map>
#include <string>

namespace tarsier::cartoon {
namespace {

// An image made with integer arithmetic: shaded areas with edges, thin lines, noise. A patch of
// skin colour in the middle covers the seeds of alien and smooth.
cv::Mat image(int width, int height, std::uint64_t seed) {
  Rng rng(seed);
  cv::Mat result(height, width, CV_8UC3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const int area = (x / 37 + y / 29) % 4;
      const bool line = (x + 2 * y) % 53 == 0;
      const int dx = 2 * x - width, dy = 2 * y - height;
      const bool skin = dx * dx * 4 + dy * dy * 2 < height * height;
      const int base[3] = {skin ? 130 : 60 * area, skin ? 160 : 255 - 70 * area,
                           skin ? 210 : (x * 255) / width};
      for (int c = 0; c < 3; ++c) {
        const int value = line ? 10 : base[c] + rng.integer(-9, 9) + (y * 20) / height;
        result.ptr(y)[3 * x + c] = cv::saturate_cast<std::uint8_t>(value);
      }
    }
  }
  return result;
}

// FNV-1a over the pixels.
std::uint64_t sum_of(const cv::Mat& image) {
  std::uint64_t sum = 1469598103934665603U;
  for (int y = 0; y < image.rows; ++y) {
    const std::uint8_t* row = image.ptr(y);
    for (size_t i = 0; i < static_cast<size_t>(image.cols) * image.elemSize(); ++i) {
      sum = (sum ^ row[i]) * 1099511628211U;
    }
  }
  return sum;
}

const std::map<std::string, std::uint64_t>& expected() {
  static const std::map<std::string, std::uint64_t> sums = {
      {"alien 128x96", 2983199722159564317U},
      {"alien 128x96 steady", 8270450582048647143U},
      {"alien 333x247", 8290822394385779596U},
      {"alien 333x247 steady", 5943700273309378701U},
      {"cartoon 128x96", 14680410186725878214U},
      {"cartoon 128x96 steady", 10966393830596232621U},
      {"cartoon 333x247", 1379878905350780834U},
      {"cartoon 333x247 steady", 3047735166903389295U},
      {"evil 128x96", 12208232702960559829U},
      {"evil 128x96 steady", 5924553549437764917U},
      {"evil 333x247", 12254925316931110732U},
      {"evil 333x247 steady", 14162895535747484292U},
      {"evil-sketch 128x96", 3717177674506122418U},
      {"evil-sketch 128x96 steady", 8008623709139872746U},
      {"evil-sketch 333x247", 153797858049982994U},
      {"evil-sketch 333x247 steady", 17538852907935633926U},
      {"none 128x96", 6256066971869308732U},
      {"none 128x96 steady", 6256066971869308732U},
      {"none 333x247", 4694267045987565810U},
      {"none 333x247 steady", 4694267045987565810U},
      {"paint 128x96", 6282730142935153988U},
      {"paint 128x96 steady", 6282730142935153988U},
      {"paint 333x247", 17009790810997094434U},
      {"paint 333x247 steady", 17009790810997094434U},
      {"sketch 128x96", 1860746824899586044U},
      {"sketch 128x96 steady", 3812647579502901488U},
      {"sketch 333x247", 16133577614653809243U},
      {"sketch 333x247 steady", 2034545954977015768U},
      {"smooth 128x96", 15088104593063562253U},
      {"smooth 128x96 steady", 5945795140396782535U},
      {"smooth 333x247", 2383681129303701766U},
      {"smooth 333x247 steady", 8187257945787487851U},
  };
  return sums;
}

TEST(PixelsTest, AreTheSameOnEveryProcessor) {
  const SimdLevel best = simd_level();
  for (const SimdLevel level :
       {SimdLevel::kBaseline, SimdLevel::kSse41, SimdLevel::kAvx2, SimdLevel::kAvx512}) {
    if (level > hardware_simd_level()) continue;
    limit_simd_level(level);
    // The plain C++ level uses OpenCV for painting, which does not round its weights. No supported
    // processor has this level.
    if (!kernels().vectorized) continue;
    for (const Mode mode : all_modes()) {
      for (const auto& [width, height] : {std::pair{333, 247}, std::pair{128, 96}}) {
        for (const bool steady : {false, true}) {
          CartoonOptions options;
          options.mode = mode;
          options.steady.on = steady;
          CartoonState state;
          std::uint64_t sum = 0;
          for (std::uint64_t frame = 0; frame < 3; ++frame) {  // --steady keeps state
            sum = sum * 31 + sum_of(cartoonize(image(width, height, frame), options, state));
          }
          const std::string name =
              fmt::format("{} {}x{}{}", name_of(mode), width, height, steady ? " steady" : "");
          const auto at = expected().find(name);
          EXPECT_TRUE(at != expected().end() && at->second == sum)
              << "{\"" << name << "\", " << sum << "U},  // with " << tarsier::name_of(level);
        }
      }
    }
  }
  limit_simd_level(best);
}

}  // namespace
}  // namespace tarsier::cartoon
