// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/networks/quad.h"

#include <opencv2/core.hpp>

#include <vector>

// Pools several views of one line of text before decoding.
namespace tarsier::plate {

// Position of an output column along the text's quad, 0..1, for a canvas of `width` px.
[[nodiscard]] float along(int column, int width);

// The quad of a view, around the centre of the text's quad: factors of its length and height.
struct TextView {
  float along = 1;
  float across = 1;
};
[[nodiscard]] Quad view_quad(const Quad& text, const TextView& view);

// The geometric mean of the views' class probabilities, in the columns of the text's own quad: p(k)
// ~ exp(1/n sum_i ln p_i(k)). This is a product of experts of equal powers (Hinton, Neural
// Computation 2002). For each column, n counts the views that cover it.
class PooledLine {
 public:
  explicit PooledLine(int width);  // width of the canvas, px

  // `probabilities`: width / kColumnStride rows x kClasses, CV_32F, the result of read_line() for
  // view_quad(text, view).
  void add(const cv::Mat& probabilities, const TextView& view);

  // Has the same shape. In a column that no view covers, all classes are equal.
  [[nodiscard]] cv::Mat mean() const;

 private:
  int width_;
  cv::Mat sum_;  // of logarithms
  std::vector<float> view_counts_;
};

}  // namespace tarsier::plate
