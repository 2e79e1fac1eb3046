// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <cstdint>
#include <optional>

namespace tarsier::synth {

// An image that encodes the time at which it was made. Reading it from a received frame gives the
// latency of camera, network and decoder. Frame number (32 bits), time (48 bits) and check sum (16
// bits) form a field of 16x6 black and white cells in the upper part; human-readable digits are
// below.
struct ClockReading {
  std::uint32_t frame = 0;
  // CLOCK_MONOTONIC (std::chrono::steady_clock) modulo 2^48, microseconds.
  std::int64_t time_us = 0;
};

// steady_clock in the encoded form.
[[nodiscard]] std::int64_t clock_now_us();

// CV_8UC3; at least 64x48 px.
[[nodiscard]] cv::Mat render_clock(cv::Size size, const ClockReading& reading);

// Decodes an image (CV_8UC3 or CV_8UC1) of render_clock, also after moderate compression, resizing
// or filtering. Empty for another image or a wrong check sum.
[[nodiscard]] std::optional<ClockReading> decode_clock(const cv::Mat& image);

}  // namespace tarsier::synth
