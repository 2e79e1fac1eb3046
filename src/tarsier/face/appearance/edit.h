// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/appearance/synthesis.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <string_view>

// Changes of a face in an image: its points are moved along the model's shape modes, the image
// goes with them, and what was hidden (the inside of a mouth) is the model's.
namespace tarsier::face::appearance {

enum class FaceEdit { kOpenMouth, kRaiseBrows };
[[nodiscard]] std::string_view name_of(FaceEdit edit);     // "mouth", "brows"
[[nodiscard]] FaceEdit parse_edit(std::string_view name);  // throws std::invalid_argument

// Where the 68 points (300-W order, px) come to lie; `amount` 1: as far as is natural, 0..2. What
// the shape modes can follow of the change, within 3 standard deviations, is added to the points.
// Throws std::invalid_argument for other numbers of points.
[[nodiscard]] Eigen::Matrix2Xd edited_points(const AppearanceModel& model,
                                             const Eigen::Matrix2Xd& points, FaceEdit edit,
                                             double amount = 1);

// Draws the face at `from` again at `to` (2 x 68, px) in `image` (CV_8UC3): each triangle of the
// image is moved, those between the lips are drawn by the model.
void draw_edited(const Synthesis& synthesis, const AppearanceModel& model, cv::Mat& image,
                 const Eigen::Matrix2Xd& from, const Eigen::Matrix2Xd& to);

}  // namespace tarsier::face::appearance
