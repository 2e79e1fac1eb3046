// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/regression/training_face.h"

#include <Eigen/Core>

#include <cstdint>
#include <functional>
#include <stop_token>
#include <vector>

// The starts from which regressors are trained.
namespace tarsier::face::regression {

// The mean shape (2 x n, centred, size 1) at this centre (px) with this size (px) and rotation
// (radians, clockwise in the image).
[[nodiscard]] Eigen::Matrix2Xd place_mean_shape(const Eigen::Matrix2Xd& mean,
                                                const Eigen::Vector2d& center, double size,
                                                double angle);

// Mean shapes near each face, as placed by a detector's boxes. Without a detected shape, they are
// scattered around the true shape (shift normal, 9 % of the size; scale log-normal, 10 %; rotation
// 10 degrees). With a detected shape, every second one is scattered around it (half as wide), so
// that the detector's mean offset is learned too. `detected`: one shape per face, as the detector's
// box places it (2 x n, px of the face's image), 2 x 0 if not detected; or an empty list.
[[nodiscard]] std::vector<Start> scattered_starts(
    const std::vector<TrainingFace>& faces, const Eigen::Matrix2Xd& mean, int each,
    std::uint64_t seed, const std::vector<Eigen::Matrix2Xd>& detected = {});

// Returns shapes near a face's points (2 x n px of the face's image each), from which fits may
// start besides the mean shape. Must be deterministic by the seed and thread-safe.
using StartShapes = std::function<std::vector<Eigen::Matrix2Xd>(const TrainingFace& face, int count,
                                                                std::uint64_t seed)>;

// The shapes that `shapes` returns for each face (asked for `each`), slightly displaced. Throws
// Interrupted; std::invalid_argument for a shape with another number of points or with points that
// are not finite.
[[nodiscard]] std::vector<Start> shaped_starts(const std::vector<TrainingFace>& faces,
                                               const StartShapes& shapes, int each,
                                               std::uint64_t seed, const std::stop_token& stop);

}  // namespace tarsier::face::regression
