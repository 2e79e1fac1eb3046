// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/regression/training_face.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <optional>
#include <vector>

// The steps of Annotator that compare images directly, without a model.
namespace tarsier::face::proposals {

// Transfers points (px; NaN: missing) from one image to another. Each point is tracked by pyramidal
// optical flow (Lucas and Kanade, IJCAI 1981) forwards and backwards. A similarity is fitted
// robustly to the tracked points; lost and missing points move by it. Empty if too few points are
// tracked.
[[nodiscard]] std::optional<Eigen::Matrix2Xd> transfer_by_flow(const cv::Mat& from,
                                                               const Eigen::Matrix2Xd& points,
                                                               const cv::Mat& to);

// Returns the mean shape, upright, where the mean image of the faces (warped to their mean shape)
// matches best by normalised correlation. Searches the whole of `gray`, at sizes around that of
// `last` (points, px) and of the faces.
[[nodiscard]] std::optional<Eigen::Matrix2Xd> match_mean_image(
    const std::vector<regression::TrainingFace>& faces, const Eigen::Matrix2Xd& mean,
    const cv::Mat& gray, const Eigen::Matrix2Xd& last);

// Moves each point a little, to where its surroundings match those of the same point in the most
// similar faces. Compares small windows by normalised correlation, in the frame of the shape.
[[nodiscard]] Eigen::Matrix2Xd refine(const std::vector<regression::TrainingFace>& faces,
                                      const cv::Mat& gray, const Eigen::Matrix2Xd& points);

}  // namespace tarsier::face::proposals
