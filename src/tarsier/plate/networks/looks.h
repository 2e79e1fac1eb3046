// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/networks/quad.h"

#include <opencv2/core.hpp>

#include <vector>

// Several looks at one line of text, pooled before it is decoded.
namespace tarsier::plate {

// Where in the text's quad the output column of a canvas of `width` px lies, 0..1.
[[nodiscard]] float along(int column, int width);

// A look's quad around the middle of the text's: factors of its length and height.
struct Look {
  float along = 1;
  float across = 1;
};
[[nodiscard]] Quad seen_by(const Quad& text, const Look& look);

// The geometric mean of the looks' class probabilities, in the columns of the text's own quad:
// p(k) ~ exp(1/n sum_i ln p_i(k)), the product of experts of equal powers (Hinton, Neural
// Computation 2002). A column counts the looks that reach as far.
class PooledLine {
 public:
  explicit PooledLine(int width);  // px of the canvas

  // `probabilities`: width / kColumn rows x kClasses, CV_32F, as read_line() gives them for
  // seen_by(text, look).
  void add(const cv::Mat& probabilities, const Look& look);

  // The same form. A column that no look reached has every class alike.
  [[nodiscard]] cv::Mat mean() const;

 private:
  int width_;
  cv::Mat sum_;  // of logarithms
  std::vector<float> looks_;
};

}  // namespace tarsier::plate
