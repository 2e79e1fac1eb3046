// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/markers/dictionary.h"
#include "tarsier/synth/planar_scene.h"

#include <opencv2/core.hpp>

#include <cstdint>

// Prints and the background on which they lie. Deterministic for a given seed on all machines.
namespace tarsier::synth {

// A marker with a white margin one cell wide, CV_8UC1; each cell has `cell_px` (1..256) pixels.
[[nodiscard]] cv::Mat marker_image(const planar::markers::Dictionary& family, int id,
                                   int cell_px = 24);
// The same as a print whose black square is `side` m wide. Its `part` is the black square.
[[nodiscard]] PlanarPrint marker_print(const planar::markers::Dictionary& family, int id,
                                       double side);

// A synthetic poster: coloured shapes, strokes and grain at all scales; CV_8UC3.
[[nodiscard]] cv::Mat poster_image(cv::Size size, std::uint64_t seed);

// A cluttered desk, floor or wall: boards or tiles, sheets with lines of print, pens, disks,
// windows, dark squares that are not markers, grain; CV_8UC3, size x size px (64..4096).
[[nodiscard]] cv::Mat clutter_image(int size, std::uint64_t seed);

// A cover: a hand with its fingers (`is_hand`) or a bar, CV_8UC4; the rest is transparent.
[[nodiscard]] PlanarPrint occluder_print(bool is_hand, double width, std::uint64_t seed);

}  // namespace tarsier::synth
