// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/mapper_input.h"
#include "tarsier/sfm/mapper/mapper_options.h"
#include "tarsier/sfm/mapper/reconstruction.h"
#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <vector>

// Places that a model lacks. Where two adjacent places look alike, as two equal houses side by
// side, the images of both are registered as if there were one, and all that lies behind is
// displaced. Images of one house agree with this. An image of the joint does not: it shows the end
// of the first house beside the beginning of the second, which in the model are the two ends of one
// house. So it fits the model in two ways, by one half each, and is registered in neither or by few
// points.
namespace tarsier::sfm {

struct MissingPlace {
  int image = 0;
  int model = 0;
  // Features that fit the model by the best pose, and others that fit it by a second pose.
  int first_features = 0;
  int second_features = 0;
};

// Finds images that show a place which a model lacks. All of these hold:
// - the image is in no model, or its matches contradict its pose (contradicted_images.h);
// - it has two poses in the model: 20 features or more fit the first, 7 others the second, and a
//   line separates the features of both in the image;
// - the model contradicts either pose: on the other side of the line, ten of its points or more
//   should be found, and none is there;
// - the same holds for every model with which the image has 10 matched features or more. Otherwise
//   the image continues a model at its end, and matches with other models are wrong.
// `models`: of all `images`; only `features` and `camera` of these are used. Ordered by image.
[[nodiscard]] std::vector<MissingPlace> missing_places(const std::vector<Image>& images,
                                                       const std::vector<Pair>& pairs,
                                                       const std::vector<Model>& models,
                                                       const MapperOptions& options);

// Counts them in the shapes of a reconstruction from `input`.
void count_missing_places(const MapperInput& input, const MapperOptions& options,
                          Reconstruction& made);

}  // namespace tarsier::sfm
