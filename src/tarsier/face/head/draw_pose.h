// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/head/head_model.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

// Draws poses on images (CV_8UC3 BGR or CV_8UC1, of the camera's size or a crop that begins at its
// origin). Lines behind the camera or outside the image are clipped. Lengths are in the unit of the
// pose's translation.
namespace tarsier::face::head {

// The object's axes from its origin: x red, y green, z blue, the farthest first, labelled at their
// ends. A length may be negative (z = -80 makes the line point out of the nose); 0 omits the axis.
// Throws std::invalid_argument unless all lengths are finite.
void draw_axes(cv::Mat& image, const geometry::Camera& camera,
               const geometry::Rigid3& camera_from_object, const Eigen::Vector3d& lengths,
               bool with_names = true);

// The edges of a box whose corners in the object's frame are `low` and `high`; hidden edges are
// thin and dark.
void draw_box(cv::Mat& image, const geometry::Camera& camera,
              const geometry::Rigid3& camera_from_object, const Eigen::Vector3d& low,
              const Eigen::Vector3d& high, const cv::Scalar& color = {0, 220, 255});

// The head's lines and points (shape: 3 x n, shape_of(model, b)).
void draw_head(cv::Mat& image, const geometry::Camera& camera,
               const geometry::Rigid3& camera_from_head, const HeadModel& model,
               const Eigen::Matrix3Xd& shape, const cv::Scalar& color = {0, 220, 255});

}  // namespace tarsier::face::head
