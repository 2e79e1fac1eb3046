// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/sift.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/matx.hpp>

#include <cstdint>
#include <vector>

// Features for images that were taken from far apart. A small piece of a surface that one image shows from the front and another one
// from the side is compressed there along one direction, by the tilt 1 / cos(angle). SIFT bears tilts of about 2. ASIFT (Morel
// and Yu, ASIFT: a new framework for fully affine invariant image comparison, SIAM J. Imaging Sciences 2009) simulates the
// tilts of both images instead, and compares the views of one with those of the other.
namespace tarsier::sfm {

// The image turned by `angle` and then compressed along x by `tilt`.
struct SimulatedView {
  double tilt = 1;   // >= 1
  double angle = 0;  // rad, 0..pi
};

// Those that add_simulated_views() makes, by tilt and then by angle: the steps of a tilt t are 72 degrees / t, as in ASIFT.
[[nodiscard]] std::vector<SimulatedView> simulated_views();

struct ViewImage {
  cv::Mat pixels;               // CV_8UC1
  cv::Matx23d image_from_view;  // px, pixel centres at integers
};
// `gray`: CV_8UC1. Blurred along x before, by 0.8 sqrt(tilt^2 - 1) px, against aliasing. Where the view shows nothing of the image
// its border goes on.
[[nodiscard]] ViewImage simulate_view(const cv::Mat& gray, const SimulatedView& view);

// Adds what the views of `gray` show to its features, `plain`, which keep their places and their numbers. A feature of a view at
// the place of one that there is already becomes a further descriptor of that, unless it says hardly more than those that
// it has; one at a new place becomes a feature, where the least tilt shows it. Returns the owners of the further descriptors, which
// stand behind those of the features (Features::owners). Of all views together so many features come in as three times
// options.max_count. Throws std::invalid_argument as find_sift(). The same for any number of threads.
[[nodiscard]] std::vector<std::int32_t> add_simulated_views(const cv::Mat& gray,
                                                            const SiftOptions& options,
                                                            SiftFeatures& features);

}  // namespace tarsier::sfm
