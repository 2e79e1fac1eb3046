// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <string_view>
#include <vector>

namespace tarsier::plate {

inline constexpr int kCharacterSize = 20;  // px, square, bright on dark
inline const cv::Size kPlateSize{144, 33};

// Projection histograms (share of bright pixels in each column, then in each row, divided by the
// largest) and the image reduced to thumbnail_size^2 px, in row-major order: 40 + thumbnail_size^2
// numbers. CV_8UC1, 20x20. `thumbnail_size`: 1..20.
[[nodiscard]] std::vector<float> projection_features(const cv::Mat& character, int thumbnail_size);

// Histograms of oriented gradients (Dalal and Triggs, CVPR 2005): cells of cell x cell px, `bins`
// unsigned orientations with bilinear interpolation, overlapping blocks of 2x2 cells, each
// normalised to 1 after clipping at 0.2. CV_8UC1 of any size.
[[nodiscard]] std::vector<float> hog_features(const cv::Mat& gray, int cell, int bins);

// Histograms of local binary patterns (Ojala et al., PAMI 2002), 59 uniform patterns, in a grid of
// columns x rows. CV_8UC1.
[[nodiscard]] std::vector<float> lbp_features(const cv::Mat& gray, int columns, int rows);

enum class PlateFeatures { kPixels, kHog, kPca, kLbp };
[[nodiscard]] PlateFeatures parse_plate_features(
    std::string_view name);  // throws std::invalid_argument
[[nodiscard]] std::string_view name_of(PlateFeatures features);

// Features of a plate candidate, 144x33. kPca gives the pixels; the model does the projection.
[[nodiscard]] std::vector<float> plate_features(const cv::Mat& candidate, PlateFeatures features);

}  // namespace tarsier::plate
