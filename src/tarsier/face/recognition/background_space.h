// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/face/recognition/recognizer.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

// Faces in the fixed directions of a background, for galleries that grow: the numbers of a face
// depend on nobody else who is enrolled, so they are made once and stay. What is learned from a
// gallery (its mean, the scatter within its people, the calibration) is learned within these
// directions, and turns the numbers into templates by one small matrix.
namespace tarsier::face::recognition {

// B (x - m) for the descriptor x of a face (with a network: its numbers), mean m and directions B of the background; then the
// squared length of what B does not hold, |x - m|^2 - |B (x - m)|^2. Throws std::invalid_argument
// for a background without directions or of other descriptors.
[[nodiscard]] std::vector<float> coordinates_of(const Background& background, const cv::Mat& face,
                                                const DescriptorOptions& descriptor = {});
// The same of descriptors, a row each.
[[nodiscard]] Rows coordinates_of_rows(const Background& background, const Rows& described);
[[nodiscard]] int coordinate_count(const Background& background);  // directions + 1

// A number > 0 that tells backgrounds (mean and directions) and descriptors apart: coordinates of
// two that differ do not go together.
[[nodiscard]] std::int64_t fingerprint(const Background& background,
                                       const DescriptorOptions& descriptor = {});

// The default or deep recogniser learned from coordinates (a row each), within the background's directions
// alone. Its templates are those of these rows. At most a few thousand: time and memory grow with
// the square of their number in the calibration. Throws std::invalid_argument, Interrupted.
[[nodiscard]] Recognizer train_coordinates(const Rows& coordinates,
                                           std::span<const std::string> labels,
                                           const RecognizerOptions& options, Progress& progress,
                                           const std::stop_token& stop,
                                           const Background& background);

// The templates that template_of() of a model of train_coordinates() makes, from coordinates (a
// row each).
[[nodiscard]] Rows templates_of_coordinates(const Recognizer& model, const Background& background,
                                            const Rows& coordinates);

// The same for callers that come back with a few rows at a time: what does not depend on these is
// made once.
class CoordinateProjection {
 public:
  // Throws std::invalid_argument for a background without directions, or of another model.
  CoordinateProjection(const Recognizer& model, const Background& background);
  [[nodiscard]] Rows operator()(const Rows& coordinates) const;
  [[nodiscard]] int coordinates() const { return static_cast<int>(inner_.cols()) + 1; }
  [[nodiscard]] int numbers() const { return static_cast<int>(inner_.rows()); }

 private:
  Rows shift_;  // 1 x m
  Rows inner_;  // c x m
  Eigen::VectorXd importance_;
  double rest_ = 1;
};

}  // namespace tarsier::face::recognition
