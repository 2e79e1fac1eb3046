// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/synth/planar_worlds.h"

#include <cstdint>
#include <string>
#include <string_view>

// The videos "synth:markers?..." and "synth:planar?...": a camera above a desk with prints.
namespace tarsier::synth {

struct PlanarSourceOptions {
  bool posters = false;  // 0.2 m wide images instead of markers
  std::string family = "36h11";
  int prints = 0;      // 0: 4 markers or 1 poster
  double side = 0.05;  // m, of a marker
  VideoOptions video;
};

inline constexpr std::string_view kPlanarSourceKeys =
    "family=36h11, prints=4, side=0.05, speed=25 (px a frame), tilt=50, shutter=0.25, "
    "exposure=0.2, blur=0.5, cover=1, distorted=0";

// Sets the option `key`; `is_good` becomes whether the value is valid. Returns false for an unknown
// key.
[[nodiscard]] bool set_planar_source(std::string_view key, std::string_view value,
                                     PlanarSourceOptions& options, bool& is_good);

// Throws UsageError for an unknown family. The source adds the noise.
[[nodiscard]] PlanarVideo planar_source_video(const PlanarSourceOptions& options, cv::Size size,
                                              double fps, std::uint64_t seed);

// {"camera": {...}, "markers": [...]}: a JSON object.
[[nodiscard]] std::string planar_source_truth(const PlanarVideo& video, double time_s);

// Poster `id` of a seed, as in the video: 600 x 450 px, 0.2 m wide.
[[nodiscard]] PlanarPrint poster_print(int id, std::uint64_t seed);

}  // namespace tarsier::synth
