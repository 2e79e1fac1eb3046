// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/appearance/synthesis.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <string_view>

// Edits a face in an image. Its points are moved along the model's shape modes and the image is
// warped with them. Regions that were hidden (the inside of a mouth) are drawn by the model.
namespace tarsier::face::appearance {

enum class FaceEdit { kOpenMouth, kRaiseBrows };
[[nodiscard]] std::string_view name_of(FaceEdit edit);     // "mouth", "brows"
[[nodiscard]] FaceEdit parse_edit(std::string_view name);  // throws std::invalid_argument

// The new positions of the 68 points (300-W order, px). `amount`: 0..2; 1 is a natural maximum. The
// part of the change that the shape modes can represent, within 3 standard deviations, is added to
// the points. Throws std::invalid_argument for other numbers of points.
[[nodiscard]] Eigen::Matrix2Xd edited_points(const AppearanceModel& model,
                                             const Eigen::Matrix2Xd& points, FaceEdit edit,
                                             double amount = 1);

// Redraws the face at `from` in the positions `to` (2 x 68, px) in `image` (CV_8UC3). Each triangle
// of the image is warped; those between the lips are drawn by the model.
void draw_edited(const Synthesis& synthesis, const AppearanceModel& model, cv::Mat& image,
                 const Eigen::Matrix2Xd& from, const Eigen::Matrix2Xd& to);

}  // namespace tarsier::face::appearance
