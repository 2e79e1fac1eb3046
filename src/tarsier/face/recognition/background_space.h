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

// Coordinates of faces in the fixed directions of a background, for galleries that grow. The
// coordinates of a face do not depend on the enrolled people, so they are computed once and kept.
// What is learned from a gallery (its mean, the scatter within its people, the calibration) is
// learned within these directions. It converts coordinates into templates by one small matrix.
namespace tarsier::face::recognition {

// B (x - m) for the descriptor x of a face (with a network: its embedding), mean m and directions B
// of the background. The last element is the squared length of the part outside B, |x - m|^2 - |B
// (x - m)|^2. Throws std::invalid_argument for a background without directions or with other
// descriptors.
[[nodiscard]] std::vector<float> coordinates_of(const Background& background, const cv::Mat& face,
                                                const DescriptorOptions& descriptor = {});
// The same for descriptors, one per row.
[[nodiscard]] Rows coordinates_of_rows(const Background& background, const Rows& described);
[[nodiscard]] int coordinate_count(const Background& background);  // directions + 1

// A number > 0 that identifies the background (mean and directions) and the descriptor. Coordinates
// with different fingerprints cannot be combined.
[[nodiscard]] std::int64_t fingerprint(const Background& background,
                                       const DescriptorOptions& descriptor = {});

// Trains the default or deep recogniser on coordinates (one per row), within the background's
// directions alone. Its templates are those of these rows. At most a few thousand rows: time and
// memory of the calibration grow with the square of their number. Throws std::invalid_argument,
// Interrupted.
[[nodiscard]] Recognizer train_coordinates(const Rows& coordinates,
                                           std::span<const std::string> labels,
                                           const RecognizerOptions& options, Progress& progress,
                                           const std::stop_token& stop,
                                           const Background& background);

// The templates that template_of() of a model of train_coordinates() gives, computed from
// coordinates (one per row).
[[nodiscard]] Rows templates_of_coordinates(const Recognizer& model, const Background& background,
                                            const Rows& coordinates);

// The same for repeated calls with a few rows each: what does not depend on the rows is computed
// once.
class CoordinateProjection {
 public:
  // Throws std::invalid_argument for a background without directions, or one that the model was not
  // trained with.
  CoordinateProjection(const Recognizer& model, const Background& background);
  [[nodiscard]] Rows operator()(const Rows& coordinates) const;
  [[nodiscard]] int coordinates() const { return static_cast<int>(inner_.cols()) + 1; }
  [[nodiscard]] int numbers() const { return static_cast<int>(inner_.rows()); }

 private:
  Rows shift_;  // 1 x m
  Rows inner_;  // c x m
  Eigen::VectorXd eigenvalues_;
  double residual_variance_ = 1;
};

}  // namespace tarsier::face::recognition
