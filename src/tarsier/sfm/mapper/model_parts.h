// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <vector>

namespace tarsier::sfm {

// A model without points, with these cameras and images. Only images with `has_features` have their
// features.
[[nodiscard]] Model model_with_features(const std::vector<geometry::Camera>& cameras,
                                        const std::vector<Image>& images,
                                        const std::vector<char>& has_features);
// The number of features of each image, as make_tracks() needs it.
[[nodiscard]] std::vector<int> feature_counts(const Model& model);

// Keeps the largest part of a model. A part starts with two images. An image joins it that shows at
// least `min_common` points which two images of the part show. Such points fix the relative scale.
// Two parts with only one image in common, or with points that only one image of each shows, have
// no known relative scale. Of equally large parts, the one with the first image is kept. Images
// outside the part become unregistered and lose their features. Points are removed that images
// outside showed and that fewer than three images of the part show. Every point of `model` has
// observations, before and after. Returns the number of images left out.
int keep_largest_part(Model& model, int min_common = 8);

}  // namespace tarsier::sfm
