// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/features/sift.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/matx.hpp>

#include <cstdint>
#include <vector>

// Features for wide baselines. A small piece of a surface that one image shows from the front and
// another from the side is compressed there in one direction, by the tilt 1 / cos(angle). SIFT
// tolerates tilts of about 2. ASIFT (Morel and Yu, ASIFT: a new framework for fully affine
// invariant image comparison, SIAM J. Imaging Sciences 2009) simulates the tilts of both images and
// compares all their views.
namespace tarsier::sfm {

// The image rotated by `angle` and then compressed along x by `tilt`.
struct SimulatedView {
  double tilt = 1;   // >= 1
  double angle = 0;  // rad, 0..pi
};

// The views that add_simulated_views() uses, by tilt and then by angle. The angular step for a tilt
// t is 72 degrees / t, as in ASIFT.
[[nodiscard]] std::vector<SimulatedView> simulated_views();

struct ViewImage {
  cv::Mat pixels;               // CV_8UC1
  cv::Matx23d image_from_view;  // px, pixel centres at integers
};
// `gray`: CV_8UC1. It is first blurred along x by 0.8 sqrt(tilt^2 - 1) px against aliasing. Outside
// the image its border is replicated.
[[nodiscard]] ViewImage simulate_view(const cv::Mat& gray, const SimulatedView& view);

// Adds features of the views of `gray` to its ordinary features, which keep their positions and
// indices. A view's feature at the position of an existing one becomes a further descriptor of that
// one, unless it is nearly equal to a known descriptor. At a new position it becomes a new feature,
// where the view of least tilt shows it. Returns the owners of the further descriptors, whose rows
// follow those of the features (Features::owners). All views together are searched for three times
// options.max_count features. Throws std::invalid_argument as find_sift(). Does not depend on the
// number of threads.
[[nodiscard]] std::vector<std::int32_t> add_simulated_views(const cv::Mat& gray,
                                                            const SiftOptions& options,
                                                            SiftFeatures& features);

}  // namespace tarsier::sfm
