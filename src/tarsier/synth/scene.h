// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <cstdint>

namespace tarsier::synth {

// A still life, ray-traced: fruit, a vase, a mug, books and a ball on a wooden table before a wall,
// under a soft light from the left. Free to use for any purpose, for documents, tests and
// benchmarks. The camera sways slowly with `time_s`; the seed moves and colours the objects (1 is
// the composed one). At least 16x16 px; CV_8UC3; no sensor noise. The same image for any number
// of threads.
[[nodiscard]] cv::Mat render_scene(cv::Size size, double time_s = 0, std::uint64_t seed = 1);

// A test card: colour bars, a grey ramp, fine lines, a circle.
[[nodiscard]] cv::Mat render_bars(cv::Size size, std::int64_t frame = 0);

}  // namespace tarsier::synth
