// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <cstdint>

namespace tarsier::synth {

// A ray-traced still life: fruit, a vase, a mug, books and a ball on a wooden table in front of a
// wall, with soft light from the left. Free to use for any purpose: documents, tests, benchmarks.
// The camera sways slowly with `time_s`. The seed moves and colours the objects (1 is the composed
// arrangement). At least 16x16 px; CV_8UC3; no sensor noise. The image does not depend on the
// number of threads.
[[nodiscard]] cv::Mat render_scene(cv::Size size, double time_s = 0, std::uint64_t seed = 1);

// A test card: colour bars, a grey ramp, fine lines, a circle.
[[nodiscard]] cv::Mat render_bars(cv::Size size, std::int64_t frame = 0);

}  // namespace tarsier::synth
