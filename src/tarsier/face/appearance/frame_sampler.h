// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/piecewise_warp.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <vector>

namespace tarsier::face::appearance {

// A piecewise affine warp for use in loops. It allocates nothing after the first call. The affine
// maps of the triangles, which warp composition also needs, are stored by the caller.
class FrameSampler {
 public:
  explicit FrameSampler(const shape::PiecewiseWarp& warp);

  // Maps a point x of the frame to linear x + shift.
  struct Affine {
    double xx = 1, xy = 0, x0 = 0, yx = 0, yy = 1, y0 = 0;
    [[nodiscard]] Eigen::Vector2d operator()(double x, double y) const {
      return {xx * x + xy * y + x0, yx * x + yy * y + y0};
    }
  };

  // The map of each triangle from the frame's points to `points` (2 x n).
  void maps(const Eigen::Matrix2Xd& points, std::vector<Affine>& out) const;

  // Bilinear samples of `values` (CV_32FC(any)): channel c of pixel k of PiecewiseWarp::pixels()
  // goes to out[k * channels + c]. Outside, the border is replicated. `out` has room for all
  // samples.
  void sample(const cv::Mat& values, const std::vector<Affine>& maps, float* out) const;

  // For each pixel whether `inside` (CV_8UC1) is not 0 at the nearest position; false outside of
  // it. Returns the number of such pixels.
  int look_up(const cv::Mat& inside, const std::vector<Affine>& maps,
              std::vector<std::uint8_t>& out) const;

  // Moves each vertex i to frame_points + step in the frame, then through the warp: the mean of the
  // results of its triangles (Matthews and Baker, IJCV 2004, section 4.2). `step`: 2 x n; `out` 2 x
  // (requested columns; the first ones).
  void compose(const std::vector<Affine>& maps, const Eigen::Matrix2Xd& step,
               Eigen::Matrix2Xd& out) const;

  [[nodiscard]] int pixels() const { return pixels_; }

 private:
  struct Run {
    int x = 0;
    int y = 0;
    int count = 0;
    int triangle = 0;
  };
  struct Inverse {  // barycentric coordinates, as affine functions
    double bx, by, b0, cx, cy, c0;
  };
  Eigen::Matrix2Xd frame_points_;
  std::vector<shape::Triangle> mesh_;
  std::vector<Run> runs_;
  std::vector<Inverse> inverse_;
  std::vector<int> first_of_vertex_;  // n + 1, into triangles_of_vertex_
  std::vector<int> triangles_of_vertex_;
  int pixels_ = 0;
};

}  // namespace tarsier::face::appearance
