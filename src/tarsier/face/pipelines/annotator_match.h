// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/landmarks/training_face.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <optional>
#include <vector>

// What an Annotator does by comparing images, without a model.
namespace tarsier::face::proposals {

// The points of one image (px; NaN: missing) in another: each followed by pyramidal optical flow
// (Lucas and Kanade, IJCAI 1981) there and back; those that get lost move as the others do, by a
// similarity fitted robustly. Missing ones come out where the others say. Nothing where too few are
// found again.
[[nodiscard]] std::optional<Eigen::Matrix2Xd> moved_along(const cv::Mat& from,
                                                          const Eigen::Matrix2Xd& points,
                                                          const cv::Mat& to);

// Where the mean image of the faces, warped to their mean shape, matches best by normalised
// correlation: the mean shape there, upright. Looks over the whole of `gray` at sizes around that
// of `last` (points, px) and of the faces.
[[nodiscard]] std::optional<Eigen::Matrix2Xd> best_place(
    const std::vector<landmarks::TrainingFace>& faces, const Eigen::Matrix2Xd& mean,
    const cv::Mat& gray, const Eigen::Matrix2Xd& last);

// Each point moved a little to where its surroundings match those of the same point in the most
// alike of the faces (normalised correlation of small windows, in the frame of the shape).
[[nodiscard]] Eigen::Matrix2Xd refine(const std::vector<landmarks::TrainingFace>& faces,
                                      const cv::Mat& gray, const Eigen::Matrix2Xd& points);

}  // namespace tarsier::face::proposals
