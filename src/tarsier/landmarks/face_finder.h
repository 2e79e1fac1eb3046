// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/detector.h"
#include "tarsier/landmarks/training_face.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::landmarks {

// From a detector's box to a first shape: the mean shape, upright, with its centre at
// (dx, dy) * box width from the box's centre and its size `size` * box width.
struct BoxModel {
  double dx = 0;
  double dy = 0;
  double size = 0.3;
  int trained_on = 0;  // boxes
  void check() const;
};

// Medians over the faces whose box holds at least `fraction` of the points (0..1); others were
// found wrong. Throws std::invalid_argument where no box is right.
[[nodiscard]] BoxModel train_box_model(const std::vector<Eigen::Matrix2Xd>& shapes,
                                       const std::vector<cv::Rect2d>& boxes, double fraction = 0.8);

// `mean` is centred and of size 1.
[[nodiscard]] Eigen::Matrix2Xd start_in_box(const BoxModel& model, const Eigen::Matrix2Xd& mean,
                                            const cv::Rect2d& box);
// The box that a detector would have drawn around a shape of this place and size.
[[nodiscard]] cv::Rect2d box_around(const BoxModel& model, const Eigen::Matrix2Xd& points);

struct HogDetector;

// A place where a face may be.
struct Candidate {
  cv::Rect2d box;    // px, as the frontal cascade, or the trained detector, draws it
  bool sure = true;  // found by the strict search; else only a fit can tell
};

struct FaceFinderOptions {
  FaceDetectorOptions detector;
  // Where the strict search finds nothing, look again less strictly, with another cascade and for
  // profiles.
  bool thorough = true;
};

// Not thread-safe.
class FaceFinder {
 public:
  // Throws ModelError where the cascades are missing (Debian: opencv-data).
  explicit FaceFinder(const FaceFinderOptions& options = {});
  // Looks with a trained detector instead of the cascades; the less strict search goes below its
  // threshold. Of `options.detector` only min_size counts.
  FaceFinder(const HogDetector& detector, const FaceFinderOptions& options);
  ~FaceFinder();
  FaceFinder(FaceFinder&&) noexcept;
  FaceFinder& operator=(FaceFinder&&) noexcept;
  // Largest first; `gray` CV_8UC1.
  [[nodiscard]] std::vector<Candidate> find(const cv::Mat& gray);
  // Only the strict search.
  [[nodiscard]] std::vector<Candidate> find_sure(const cv::Mat& gray);
  // Where shapes lie in the boxes of a trained detector; nothing: as in those of the cascade.
  [[nodiscard]] const std::optional<BoxModel>& box_model() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

[[nodiscard]] nlohmann::json to_json(const BoxModel& model);
[[nodiscard]] BoxModel box_model_from_json(const nlohmann::json& value, const std::string& path);

}  // namespace tarsier::landmarks
