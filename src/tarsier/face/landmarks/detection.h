// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/shape/import.h"

#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::face::landmarks {

// How well a detector finds boxes. Detectors draw boxes of their own kind: a candidate is compared
// by the place that its start gives the model's mean shape (start_at), in the form of the given
// boxes.
struct DetectionScore {
  int images = 0;
  int objects = 0;
  int found = 0;         // intersection over union of at least 0.4
  int false_alarms = 0;  // neither an object nor an ignored box
  double off = 0;        // mean distance of the found from their objects' middles, box widths
  double ms = 0;         // an image
};

class DetectionJudge {
 public:
  // `sides`: of a box around a shape, in root mean squared distances (see boxes_from_landmarks).
  explicit DetectionJudge(double sides = 2.8) : sides_(sides) {}
  // Each object is found at most once.
  void add(const LandmarkModel& model, const FaceFinder& finder,
           const std::vector<Candidate>& candidates, const shape::BoxedImage& truth, double ms);
  [[nodiscard]] DetectionScore score() const;

 private:
  double sides_;
  DetectionScore sum_;
};

}  // namespace tarsier::face::landmarks
