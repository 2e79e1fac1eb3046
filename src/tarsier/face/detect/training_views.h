// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <vector>

// Crops and augmentation for training the face detection networks. Internal to this module.
namespace tarsier::face::training {

struct Image {
  std::vector<cv::Mat> halves;  // CV_8UC1; make_halves()
  std::vector<cv::Rect2d> faces;
  std::vector<std::vector<cv::Point2d>>
      points;  // for each face 68 points, measured from the corners of pixels, or none
  std::vector<cv::Rect2d> ignored;
  [[nodiscard]] cv::Size size() const { return halves[0].size(); }
};

// A similarity, optionally mirrored and slightly stretched: view = A(image). Coordinates are
// measured from the corners of pixels.
struct ViewTransform {
  cv::Matx23d view_from_image;
  double scale = 1;
  [[nodiscard]] cv::Point2d operator()(const cv::Point2d& p) const;
};

// Orientation of a view: angle in radians; x is stretched by `stretch` and y by its inverse.
struct ViewOrientation {
  double angle = 0;
  bool mirrored = false;
  double stretch = 1;
};

// Maps `center` (px of the image) to `to`.
[[nodiscard]] ViewTransform view_transform(const cv::Point2d& center, const cv::Point2d& to,
                                           double scale, const ViewOrientation& orientation);
// A random view of `side` px anywhere in the image, at any scale from `smallest_scale` on.
[[nodiscard]] ViewTransform random_view(const Image& image, int side, double smallest_scale,
                                        bool wide, Rng& rng);
// Roll of up to +-36 degrees (deviation 13), mirrored half the time, stretched by 4 %. `wide`: one
// of four views has a uniform roll of up to +-48 degrees.
[[nodiscard]] ViewOrientation random_orientation(bool wide, Rng& rng);

// Outside the image, the border is replicated; or `behind` (side x side) is shown, if given.
[[nodiscard]] cv::Mat render_view(const Image& image, const ViewTransform& transform, int side,
                                  const cv::Mat* background = nullptr);

// Random changes of light, lens, sensor and compression.
void degrade(cv::Mat& view, Rng& rng);
// Occludes a part of the face.
void occlude_part(cv::Mat& view, const cv::Rect2d& box, Rng& rng);

// Log-uniform in [low, high).
[[nodiscard]] double log_uniform(Rng& rng, double low, double high);

// A synthetic image without faces: chessboards, gratings, dots, text, facades, random shapes, seen
// at an angle. CV_8UC1.
[[nodiscard]] cv::Mat draw_without_faces(Rng& rng);

}  // namespace tarsier::face::training
