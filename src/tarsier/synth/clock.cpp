// SPDX-License-Identifier: MIT
#include "tarsier/synth/clock.h"

#include "tarsier/core/require.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <chrono>

namespace tarsier::synth {
namespace {

constexpr int kColumns = 16;
constexpr int kRows = 6;
constexpr double kCellsHeight = 0.6;  // of the image; the digits are below
constexpr double kMargin = 0.03;      // of the width and height
constexpr double kDark = 40;
constexpr double kBright = 215;

using Payload = std::array<std::uint8_t, kColumns * kRows / 8>;

// CRC-16-CCITT of everything except the check sum.
std::uint16_t check_sum(const Payload& payload) {
  std::uint32_t crc = 0xffff;
  for (std::size_t i = 0; i + 2 < payload.size(); ++i) {
    crc ^= static_cast<std::uint32_t>(payload[i]) << 8U;
    for (int bit = 0; bit < 8; ++bit)
      crc = (crc & 0x8000U) != 0 ? (crc << 1U) ^ 0x1021U : crc << 1U;
  }
  return static_cast<std::uint16_t>(crc & 0xffffU);
}

Payload payload_of(const ClockReading& reading) {
  Payload payload{};
  for (std::size_t i = 0; i < 4; ++i) {
    payload[i] =
        static_cast<std::uint8_t>((reading.frame >> (8U * static_cast<unsigned>(i))) & 0xffU);
  }
  for (std::size_t i = 0; i < 6; ++i) {
    payload[4 + i] = static_cast<std::uint8_t>(
        (static_cast<std::uint64_t>(reading.time_us) >> (8U * static_cast<unsigned>(i))) & 0xffU);
  }
  const std::uint16_t sum = check_sum(payload);
  payload[10] = static_cast<std::uint8_t>(sum & 0xffU);
  payload[11] = static_cast<std::uint8_t>(sum >> 8U);
  return payload;
}

// The cell in column `c` and row `r`, reduced on each side by `inset` of its size.
cv::Rect cell(cv::Size size, int c, int r, double inset) {
  const double left = kMargin * size.width;
  const double top = kMargin * size.height;
  const double width = (1 - 2 * kMargin) * size.width / kColumns;
  const double height = (kCellsHeight - kMargin) * size.height / kRows;
  const cv::Point from(cvRound(left + (c + inset) * width), cvRound(top + (r + inset) * height));
  const cv::Point to(cvRound(left + (c + 1 - inset) * width),
                     cvRound(top + (r + 1 - inset) * height));
  return {from, cv::Point(std::max(to.x, from.x + 1), std::max(to.y, from.y + 1))};
}

}  // namespace

std::int64_t clock_now_us() {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::microseconds>(now).count() & ((1LL << 48) - 1);
}

cv::Mat render_clock(cv::Size size, const ClockReading& reading) {
  TARSIER_REQUIRE(size.width >= 64 && size.height >= 48, "{}x{} px", size.width, size.height);
  cv::Mat image(size, CV_8UC3, cv::Scalar::all(128));
  const Payload payload = payload_of(reading);
  for (int r = 0; r < kRows; ++r) {
    for (int c = 0; c < kColumns; ++c) {
      const int bit = r * kColumns + c;
      const bool is_set = ((payload[static_cast<std::size_t>(bit / 8)] >> (bit % 8)) & 1) != 0;
      image(cell(size, c, r, 0)).setTo(cv::Scalar::all(is_set ? kBright : kDark));
    }
  }
  const std::string text = fmt::format("#{}  {}.{:03} s", reading.frame,
                                       reading.time_us / 1'000'000, reading.time_us / 1000 % 1000);
  int baseline = 0;
  const cv::Size unit = cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, 1, 2, &baseline);
  const double scale =
      std::min(0.9 * size.width / unit.width, 0.2 * size.height / std::max(1, unit.height));
  const int thickness = std::max(1, cvRound(2 * scale));
  const cv::Point origin(cvRound(0.05 * size.width), cvRound(0.87 * size.height));
  cv::putText(image, text, origin, cv::FONT_HERSHEY_SIMPLEX, scale, {20, 20, 20}, thickness,
              cv::LINE_AA);
  return image;
}

std::optional<ClockReading> decode_clock(const cv::Mat& image) {
  if (image.dims != 2 || image.cols < 64 || image.rows < 48 || image.depth() != CV_8U)
    return std::nullopt;
  Payload payload{};
  for (int r = 0; r < kRows; ++r) {
    for (int c = 0; c < kColumns; ++c) {
      const cv::Scalar mean = cv::mean(image(cell(image.size(), c, r, 0.25)));
      const double level = image.channels() >= 3 ? (mean[0] + mean[1] + mean[2]) / 3 : mean[0];
      const int bit = r * kColumns + c;
      if (level > (kDark + kBright) / 2) {
        payload[static_cast<std::size_t>(bit / 8)] |=
            static_cast<std::uint8_t>(1U << static_cast<unsigned>(bit % 8));
      }
    }
  }
  const std::uint16_t sum = check_sum(payload);
  if (payload[10] != (sum & 0xffU) || payload[11] != (sum >> 8U)) return std::nullopt;
  ClockReading reading;
  for (std::size_t i = 0; i < 4; ++i) {
    reading.frame |= static_cast<std::uint32_t>(payload[i]) << (8U * static_cast<unsigned>(i));
  }
  std::uint64_t time = 0;
  for (std::size_t i = 0; i < 6; ++i)
    time |= static_cast<std::uint64_t>(payload[4 + i]) << (8U * static_cast<unsigned>(i));
  reading.time_us = static_cast<std::int64_t>(time);
  return reading;
}

}  // namespace tarsier::synth
