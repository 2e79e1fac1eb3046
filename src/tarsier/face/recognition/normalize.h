// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <string_view>
#include <vector>

// Preparation of a face for comparison: light normalisation, then a descriptor of edge directions,
// which depend little on light.
namespace tarsier::face::recognition {

enum class Light {
  kNone,
  kEqualize,   // histogram equalisation
  kLog,        // ln(4 + grey): a factor of the light becomes an offset
  kTanTriggs,  // gamma, difference of Gaussians, contrast equalisation (below)
  // grey / its own blur (Wang, Li and Wang, "Face recognition under varying lighting conditions
  // using self quotient image", FGR 2004), isotropic.
  kSelfQuotient
};

// "none", "equalize", "log", "tan-triggs", "self-quotient".
[[nodiscard]] std::string_view name_of(Light light);
[[nodiscard]] Light parse_light(std::string_view name);  // throws std::invalid_argument

// Tan and Triggs, "Enhanced local texture feature sets for face recognition under difficult
// lighting conditions", IEEE TIP 2010.
struct TanTriggsOptions {
  double gamma = 0.2;  // grey^gamma
  double inner = 1;    // sigma of the Gaussians, px, 0 < inner < outer <= 50
  double outer = 2;
  double alpha = 0.1;  // of the contrast equalisation
  double limit = 10;   // tau: large values are compressed to it by tanh

  [[nodiscard]] OptionFields fields() {
    return {
        {"gamma", gamma, above(0, 1)}, {"alpha", alpha, above(0, 1)}, {"limit", limit, above(0)}};
  }
  void check() const;
};

// `gray` is CV_8UC1; the result is CV_32FC1 of the same size. Flat images give zeros
// (kTanTriggs), never NaN. Throws std::invalid_argument for another type.
[[nodiscard]] cv::Mat tan_triggs(const cv::Mat& gray, const TanTriggsOptions& options = {});
[[nodiscard]] cv::Mat self_quotient(const cv::Mat& gray, double sigma_px = 3);
[[nodiscard]] cv::Mat normalize_light(const cv::Mat& gray, Light light);

// For display: CV_8UC1, the central 96 % of the values stretched to 0..255.
[[nodiscard]] cv::Mat light_image(const cv::Mat& normalized);

// Histograms of gradient directions (Dalal and Triggs, CVPR 2005) on a regular grid. Each pixel is
// shared linearly between neighbouring directions, and between cells by a Gaussian whose sigma is
// half a cell. Each cell is scaled to length 1 (softly, so that noise in empty cells stays small),
// then the channel.
struct HogChannel {
  Light light = Light::kTanTriggs;
  int cell = 8;              // px, 4..64
  int directions = 9;        // 4..32, even where `full_circle`
  bool full_circle = false;  // directions over 360 degrees instead of 180
};

struct DescriptorOptions {
  cv::Size size{64, 80};  // px; faces are resized to it
  std::vector<HogChannel> channels{{Light::kTanTriggs, 8, 9, false},
                                   {Light::kLog, 6, 9, false},
                                   {Light::kTanTriggs, 8, 16, true}};
  // Average the descriptor with that of the mirrored face, so that light from the left and from the
  // right give the same descriptor. Halves its length.
  bool symmetric = true;

  [[nodiscard]] OptionFields fields() {
    return {{"size.width", size.width, range(16, 512)},
            {"size.height", size.height, range(16, 512)}};
  }
  void check() const;
};

[[nodiscard]] int descriptor_length(const DescriptorOptions& options);

// `gray`: CV_8UC1 of any size. The result has length 1 (0 for a flat image).
[[nodiscard]] std::vector<float> describe(const cv::Mat& gray, const DescriptorOptions& options);

// The face moved by (dx, dy) px, rotated by `degrees` clockwise in the image and scaled about its
// centre. Border pixels are replicated.
[[nodiscard]] cv::Mat transformed_face(const cv::Mat& gray, double dx, double dy, double degrees,
                                       double scale);

}  // namespace tarsier::face::recognition
