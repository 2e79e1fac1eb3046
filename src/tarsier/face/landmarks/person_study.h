// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/face/shape/landmark_set.h"

#include <array>
#include <cstdint>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::face::landmarks {

// Compares a person-specific model with a generic one. For each person with at least 4 images, the
// second half of the images is fitted by two supervised descents. One is trained on all other
// people (generic), one on the first half of the person's own images (specific). Both start at the
// mean shape, scattered like a detector's boxes (5 starts per image).
struct PersonStudy {
  struct Row {
    std::string person;
    int trained = 0;  // the person's own images
    int tested = 0;
    double generic = 0;  // NME, %
    double specific = 0;
  };
  std::vector<Row> rows;
  double generic = 0;  // means over the rows
  double specific = 0;
};

// Image paths of the set are relative to the current folder. Throws InputError if no person has
// enough images; Interrupted.
[[nodiscard]] PersonStudy study_persons(const shape::LandmarkSet& set,
                                        const std::array<int, 2>& eyes, std::uint64_t seed,
                                        Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::face::landmarks
