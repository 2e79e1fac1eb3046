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

// Is a model of one person better than one of many? For each person with 4 images at least, the
// second half of the images is fitted by two supervised descents: one learned from all other
// people (generic), one from the first half of the person's own (specific). Both begin at the mean
// shape, scattered as a detector scatters (5 starts an image).
struct PersonStudy {
  struct Row {
    std::string person;
    int trained = 0;  // own images
    int tested = 0;
    double generic = 0;  // NME, %
    double specific = 0;
  };
  std::vector<Row> rows;
  double generic = 0;  // means over the rows
  double specific = 0;
};

// Image paths of the set must open from the current folder. Throws InputError where no person has
// enough images; Interrupted.
[[nodiscard]] PersonStudy study_persons(const shape::LandmarkSet& set,
                                        const std::array<int, 2>& eyes, std::uint64_t seed,
                                        Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::face::landmarks
