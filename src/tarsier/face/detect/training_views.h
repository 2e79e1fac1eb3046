// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <vector>

// What the training of the networks that find faces cuts from images, and how it disturbs it.
// Internal to this module.
namespace tarsier::face::training {

struct Image {
  std::vector<cv::Mat> halves;  // CV_8UC1; make_halves()
  std::vector<cv::Rect2d> faces;
  std::vector<std::vector<cv::Point2d>>
      points;  // of each face 68, from the corners of pixels, or none
  std::vector<cv::Rect2d> ignored;
  [[nodiscard]] cv::Size size() const { return halves[0].size(); }
};

// A similarity, perhaps mirrored and a little stretched: view = An image. Coordinates run from the
// corners of pixels.
struct Place {
  cv::Matx23d view_from_image;
  double scale = 1;
  [[nodiscard]] cv::Point2d operator()(const cv::Point2d& p) const;
};

// How a view is turned: radians; x is stretched by `stretch` and y by its inverse.
struct Turn {
  double angle = 0;
  bool mirrored = false;
  double stretch = 1;
};

// `center` (px of the image) comes to lie at `to`.
[[nodiscard]] Place place(const cv::Point2d& center, const cv::Point2d& to, double scale,
                          const Turn& turn);
// A place of `side` px anywhere in the image, at any scale from `smallest_scale` on.
[[nodiscard]] Place anywhere(const Image& image, int side, double smallest_scale, bool wide,
                             Rng& rng);
// Upright to +-36 degrees (deviation 13), mirrored half the time, stretched by 4 %. `wide`: one of
// four turns is anything to +-48 degrees.
[[nodiscard]] Turn face_turn(bool wide, Rng& rng);

// What lies outside the image repeats its edge; or, with `behind` (side x side), shows that.
[[nodiscard]] cv::Mat view_of(const Image& image, const Place& where, int side,
                              const cv::Mat* behind = nullptr);

// Light, lens, sensor and compression as they may be.
void disturb(cv::Mat& view, Rng& rng);
// Something before a part of the face.
void hide_part(cv::Mat& view, const cv::Rect2d& box, Rng& rng);

// Log-uniform in [low, high).
[[nodiscard]] double log_uniform(Rng& rng, double low, double high);

// A drawing that shows no face: chessboards, gratings, dots, writing, facades, shapes at random,
// seen at an angle. CV_8UC1.
[[nodiscard]] cv::Mat draw_without_faces(Rng& rng);

}  // namespace tarsier::face::training
