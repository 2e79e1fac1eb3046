// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/shape/annotated_crop.h"
#include "tarsier/face/shape/landmark_set.h"

#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::face::appearance {

// A training sample: in colour, cropped around its points, all points present.
struct TrainingImage : shape::AnnotatedCrop {  // its image: CV_8UC3
  std::string name;
  std::string person;
};

struct LoadOptions {
  double margin = 0.6;  // kept around the points' box, share of its larger side
  int largest = 250;    // px; larger objects are reduced to this size of the points' box

  [[nodiscard]] OptionFields fields() {
    return {{"margin", margin, range(0, 4)}, {"largest", largest, range(50, 4000)}};
  }
  void check() const { check_fields(*this); }
};

// Reads the images of a set. Incomplete samples and images that cannot be read are skipped and
// listed in `skipped` ("path: reason"). Throws Interrupted; InputError(set_path) if no image is
// left.
[[nodiscard]] std::vector<TrainingImage> load_training_images(
    const shape::LandmarkSet& set, const std::string& set_path, const LoadOptions& options,
    Progress& progress, const std::stop_token& stop, std::vector<std::string>& skipped);

// The same face in the mirrored image (shape::mirrored).
[[nodiscard]] TrainingImage mirrored(const TrainingImage& image, const std::vector<int>& mirror,
                                     double to_the_right);

}  // namespace tarsier::face::appearance
