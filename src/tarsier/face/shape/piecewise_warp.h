// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/mesh.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::face::shape {

// A piecewise affine warp into a fixed frame (Matthews and Baker, "Active appearance models
// revisited", IJCV 2004, section 4.1.1). The triangle and the barycentric coordinates of each frame
// pixel in the mesh are precomputed; a warp then needs a few multiplications per pixel. Immutable
// and thread-safe.
class PiecewiseWarp {
 public:
  // `frame_points`: 2 x n, px of the frame, pixel centres at integers. The warp covers the pixels
  // of the frame of `size` whose centre is in a triangle (edges included). Throws
  // std::invalid_argument.
  PiecewiseWarp(Eigen::Matrix2Xd frame_points, std::vector<Triangle> mesh, cv::Size size);

  struct Pixel {
    int x = 0;  // in the frame
    int y = 0;
    int triangle = 0;
    float weight[3] = {};  // barycentric, sum 1
  };
  [[nodiscard]] const std::vector<Pixel>& pixels() const { return pixels_; }  // row by row
  [[nodiscard]] const std::vector<Triangle>& mesh() const { return mesh_; }
  [[nodiscard]] cv::Size size() const { return size_; }
  [[nodiscard]] const cv::Mat& mask() const { return mask_; }  // CV_8UC1, 255 in the mesh
  [[nodiscard]] const Eigen::Matrix2Xd& frame_points() const { return frame_points_; }

  // Bilinear samples of `image` for all pixels() when the mesh's points are at `points` (2 x n).
  // `out` gets one row of pixels().size() numbers per channel (channels x pixels, row-major).
  // Outside the image, the border is replicated. `image`: CV_8UC1, CV_8UC3 or CV_32FC(any). Returns
  // the share of pixels inside the image.
  double sample(const cv::Mat& image, const Eigen::Matrix2Xd& points,
                std::vector<float>& out) const;

  // The image warped into the frame, of the type of `image` (CV_8UC1, CV_8UC3); 0 outside the mesh.
  [[nodiscard]] cv::Mat to_frame(const cv::Mat& image, const Eigen::Matrix2Xd& points) const;

  // The inverse: draws `texture` (of size(), CV_8UC1 or CV_8UC3) over `image` (same type) with the
  // mesh at `points`. In a folded mesh, later triangles cover earlier ones.
  void from_frame(const cv::Mat& texture, const Eigen::Matrix2Xd& points, cv::Mat& image) const;

 private:
  struct Run {  // adjacent pixels in a row that are in the same triangle
    int x = 0;
    int y = 0;
    int count = 0;
    int triangle = 0;
  };

  Eigen::Matrix2Xd frame_points_;
  std::vector<Triangle> mesh_;
  cv::Size size_;
  std::vector<Pixel> pixels_;
  std::vector<Run> runs_;  // the same pixels in the same order
  cv::Mat mask_;
};

}  // namespace tarsier::face::shape
