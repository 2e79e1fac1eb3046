// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <cstdint>
#include <optional>

namespace tarsier::synth {

// An image that says when it was made: how old a frame is after a camera, a network and a decoder
// is measured by reading it. Frame number (32 bits), time (48 bits) and check sum (16 bits) are a
// field of 16x6 black and white cells in the upper part; digits for people are below.
struct ClockReading {
  std::uint32_t frame = 0;
  // CLOCK_MONOTONIC (std::chrono::steady_clock) modulo 2^48, microseconds.
  std::int64_t time_us = 0;
};

// steady_clock as it is drawn.
[[nodiscard]] std::int64_t clock_now_us();

// CV_8UC3; at least 64x48 px.
[[nodiscard]] cv::Mat render_clock(cv::Size size, const ClockReading& reading);

// Reads an image (CV_8UC3 or CV_8UC1) made by render_clock, also when it was compressed, resized
// or filtered moderately; nothing if it is none or the check sum fails.
[[nodiscard]] std::optional<ClockReading> decode_clock(const cv::Mat& image);

}  // namespace tarsier::synth
