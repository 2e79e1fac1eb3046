// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/mapper_input.h"
#include "tarsier/sfm/mapper/mapper_options.h"

#include <cstddef>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

class IncrementalMapper;

// The agreement of start poses with the images.
struct StartCheck {
  std::vector<char> fits;            // per image: it has a pose that agrees
  std::vector<std::string> reasons;  // per image whose pose does not agree; else ""
  int given_poses = 0;               // number of poses
  int accepted = 0;                  // number of poses that fit
  std::size_t matches = 0;           // of agreeing pairs between images that fit
  double explained_share = 0;        // share of these that are near their epipolar lines
  std::string refusal;               // why mapping cannot begin with them; or ""

  // Whether the poses need no adjustment before points are made.
  [[nodiscard]] bool is_exact() const { return explained_share >= 0.8; }
};

// Checks start poses against the matches. A pair agrees with the poses of its images as
// pair_agreement.h defines. Epipolar lines alone are not sufficient: for a camera that moves across
// the scene, those of mirrored poses are nearly the same. A pose fits where agreeing pairs have 0.3
// of its image's matches, and at least 16. The worst pose is left out until all fit. Refused where
// less than half of the poses with pairs fit, as for a mirrored model, one of another scene, or one
// with mixed-up names. `is_refused`: for each pair, whether it is not used. Throws Interrupted.
[[nodiscard]] StartCheck check_start(const StartPoses& start, const MapperInput& input,
                                     const std::vector<char>& is_refused, double reprojection_px,
                                     const std::stop_token& stop);

// A line of the log.
[[nodiscard]] std::string describe(const StartCheck& check, const StartPoses& start,
                                   const MapperOptions& options);

// All images; those that fit are registered with their poses. Without features and points.
[[nodiscard]] Model start_model(const StartCheck& check, const StartPoses& start,
                                const MapperInput& input);

// Makes points from inexact poses and adjusts both, with a maximum reprojection error that
// decreases to that of the options. Throws Interrupted.
void adjust_rough_start(IncrementalMapper& mapper, const Model& start, const MapperOptions& options,
                        const std::stop_token& stop);

// Why the points that were made do not confirm the poses; "" if at least half of the images that
// fit, and at least two, observe enough points.
[[nodiscard]] std::string why_too_few_observations(const Model& model, const StartCheck& check,
                                                   const StartPoses& start,
                                                   const MapperOptions& options);

}  // namespace tarsier::sfm
