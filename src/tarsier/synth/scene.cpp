// SPDX-License-Identifier: MIT
#include "tarsier/synth/scene.h"

#include "tarsier/core/require.h"
#include "tarsier/synth/scene_world.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace tarsier::synth {
namespace {

using still_life::cross;
using still_life::Scene;
using still_life::unit;
using still_life::Vec;

std::uint8_t develop_exactly(float light) {
  // A video tone curve, then the display's gamma.
  const float exposed = light * 1.05F;
  const float video = exposed * (1 + exposed * 0.10F) / (1 + exposed * 0.55F) * 1.12F;
  return static_cast<std::uint8_t>(
      std::clamp(255 * std::pow(std::max(video, 0.0F), 1 / 2.2F) + 0.5F, 0.0F, 255.0F));
}

// The same from a table over the square root of the light, which resolves dark tones.
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
  // Formats of 4:3 and wider show the same height; narrower images show the same width.
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

  // More samples where adjacent pixels differ, so that edges are smooth.
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
            // Very bright highlights would cause jagged edges, so they are limited.
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
  // A hand that rotates once in a hundred frames shows that the image moves.
  const double angle = 2 * CV_PI * static_cast<double>(frame % 100) / 100;
  cv::line(
      image, center,
      center + cv::Point(cvRound(radius * std::sin(angle)), cvRound(-radius * std::cos(angle))),
      {255, 255, 255}, std::max(1, size.height / 120), cv::LINE_AA);
  return image;
}

}  // namespace tarsier::synth
