// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/shape/import.h"

#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::face::landmarks {

// Accuracy of a detector. Detectors have different kinds of boxes. A candidate is therefore
// compared by the position of the model's mean shape in it (start_at), converted to the form of the
// ground-truth boxes.
struct DetectionScore {
  int images = 0;
  int objects = 0;
  int found = 0;            // intersection over union of at least 0.4
  int false_alarms = 0;     // neither an object nor an ignored box
  double center_error = 0;  // mean distance of found boxes from their objects' centres, box widths
  double ms = 0;            // per image
};

class DetectionEvaluator {
 public:
  // `sides`: side of a box around a shape, in root mean squared distances (see
  // boxes_from_landmarks).
  explicit DetectionEvaluator(double sides = 2.8) : sides_(sides) {}
  // Each object is found at most once.
  void add(const LandmarkModel& model, const FaceFinder& finder,
           const std::vector<Candidate>& candidates, const shape::BoxedImage& truth, double ms);
  [[nodiscard]] DetectionScore score() const;

 private:
  double sides_;
  DetectionScore sum_;
};

}  // namespace tarsier::face::landmarks
