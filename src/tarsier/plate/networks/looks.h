// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/networks/quad.h"

#include <opencv2/core.hpp>

#include <vector>

// Pools several views ("looks") of one line of text before decoding.
namespace tarsier::plate {

// Position of an output column along the text's quad, 0..1, for a canvas of `width` px.
[[nodiscard]] float along(int column, int width);

// The quad of a look, around the centre of the text's quad: factors of its length and height.
struct Look {
  float along = 1;
  float across = 1;
};
[[nodiscard]] Quad seen_by(const Quad& text, const Look& look);

// The geometric mean of the looks' class probabilities, in the columns of the text's own quad: p(k)
// ~ exp(1/n sum_i ln p_i(k)). This is a product of experts of equal powers (Hinton, Neural
// Computation 2002). For each column, n counts the looks that cover it.
class PooledLine {
 public:
  explicit PooledLine(int width);  // width of the canvas, px

  // `probabilities`: width / kColumn rows x kClasses, CV_32F, the result of read_line() for
  // seen_by(text, look).
  void add(const cv::Mat& probabilities, const Look& look);

  // Has the same shape. In a column that no look covers, all classes are equal.
  [[nodiscard]] cv::Mat mean() const;

 private:
  int width_;
  cv::Mat sum_;  // of logarithms
  std::vector<float> looks_;
};

}  // namespace tarsier::plate
