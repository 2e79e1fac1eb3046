// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <cstdint>

namespace tarsier::synth {

// Adds normally distributed noise of standard deviation `sigma` grey levels (0..64) to every
// channel of an 8-bit image, saturating. Depends on `seed` only, not on the number of threads.
void add_noise(cv::Mat& image, double sigma, std::uint64_t seed);

}  // namespace tarsier::synth
