// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/face_input.h"

#include "tarsier/face/regression/descent.h"
#include "tarsier/face/shape/similarity.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace tarsier::face::regression {

void face_input(const Eigen::Matrix2Xd& mean, const cv::Mat& gray, const Eigen::Matrix2Xd& points,
                int side, double scale, FaceInput& input) {
  const Reduced reduced = reduce_around(gray, points, scale);
  const Eigen::Matrix2Xd there = (points.colwise() - reduced.offset) / reduced.scale;
  const shape::Similarity2d similarity = shape::fit_similarity(mean, there);
  // From px of the frame to px of the reduced image.
  const double center = (side - 1) / 2.0;
  const double a = similarity.a / scale;
  const double b = similarity.b / scale;
  const cv::Matx23d image_from_frame(a, -b, similarity.tx - center * (a - b), b, a,
                                     similarity.ty - center * (a + b));
  cv::warpAffine(reduced.gray, input.frame, image_from_frame, cv::Size(side, side),
                 cv::INTER_LINEAR | cv::WARP_INVERSE_MAP, cv::BORDER_REPLICATE);
  cv::Scalar mean_level;
  cv::Scalar deviation;
  cv::meanStdDev(input.frame, mean_level, deviation);
  const auto shift = static_cast<float>(mean_level[0]);
  const auto gain = static_cast<float>(1 / std::max(4.0, deviation[0]));
  input.values.resize(input.frame.total());
  for (int y = 0; y < side; ++y) {
    const auto* row = input.frame.ptr<std::uint8_t>(y);
    float* out = input.values.data() + static_cast<std::ptrdiff_t>(y) * side;
    for (int x = 0; x < side; ++x) out[x] = gain * (static_cast<float>(row[x]) - shift);
  }
}

}  // namespace tarsier::face::regression
