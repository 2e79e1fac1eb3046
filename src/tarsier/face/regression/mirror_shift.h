// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/face/regression/training_face.h"
#include "tarsier/face/shape/landmark_set.h"

#include <Eigen/Core>

#include <cstdint>
#include <stop_token>
#include <string>
#include <vector>

// The offset of annotated points from a mirror-symmetric annotation, and faces corrected for it.
namespace tarsier::face::regression {

// Horizontal offset of a set's points from those of a mirror-symmetric model, px of the images
// (DescentReport::to_the_right). Trains a short descent on some of `faces`, including mirrored
// ones.
[[nodiscard]] double measured_shift(const std::vector<TrainingFace>& faces,
                                    const Eigen::Matrix2Xd& mean, std::uint64_t seed,
                                    Progress& progress, const std::stop_token& stop);
inline constexpr double kMinCorrectedShift = 0.2;  // px

// The faces of a set (paths relative to the current folder) for networks that see them in a frame
// (face_input.h), with `mirror` also mirrored. A horizontal offset of the set's points is measured
// and corrected for. Images that cannot be used are listed in `skipped`. Throws InputError,
// Interrupted.
[[nodiscard]] std::vector<TrainingFace> load_framed_faces(const shape::LandmarkSet& set,
                                                          bool mirror, std::uint64_t seed,
                                                          Progress& progress,
                                                          const std::stop_token& stop,
                                                          std::vector<std::string>& skipped);

}  // namespace tarsier::face::regression
