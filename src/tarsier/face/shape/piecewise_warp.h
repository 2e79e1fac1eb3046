// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/mesh.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::face::shape {

// A piecewise affine warp into a fixed frame (Matthews and Baker, "Active appearance models
// revisited", IJCV 2004, section 4.1.1): each pixel of the frame that lies in the mesh knows its
// triangle and its barycentric coordinates there, once and for all; a warp is then a few
// multiplications a pixel. Immutable; shared by threads.
class PiecewiseWarp {
 public:
  // `frame_points` (2 x n, px of the frame, centres at integers) and its mesh; pixels of the frame
  // of `size` whose centre lies in a triangle (edges count) take part. Throws
  // std::invalid_argument.
  PiecewiseWarp(const Eigen::Matrix2Xd& frame_points, std::vector<Triangle> mesh, cv::Size size);

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

  // Where pixel k of pixels() lies in the image when the mesh's points lie at `points`: 2 x n.
  // Bilinear samples of `image` there, one row of pixels().size() numbers for each channel, in
  // `out` (channels x pixels, row-major); outside the image: the nearest edge pixel. `image`:
  // CV_8UC1, CV_8UC3 or CV_32FC(any). Returns the share of pixels inside the image.
  double sample(const cv::Mat& image, const Eigen::Matrix2Xd& points,
                std::vector<float>& out) const;

  // The image warped into the frame, of the type of `image` (CV_8UC1, CV_8UC3); 0 outside the
  // mesh.
  [[nodiscard]] cv::Mat to_frame(const cv::Mat& image, const Eigen::Matrix2Xd& points) const;

  // The way back: draws `texture` (of size(), CV_8UC1 or CV_8UC3) over `image` (same type) where
  // the mesh lies at `points`; later triangles lie over earlier ones where it folds.
  void from_frame(const cv::Mat& texture, const Eigen::Matrix2Xd& points, cv::Mat& image) const;

 private:
  struct Run {  // neighbours in a row that lie in one triangle
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
