// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/text/reading.h"

#include <opencv2/core.hpp>

// Geometry of quadrilaterals in images. Pixel centres have integer coordinates.
namespace tarsier::plate {

[[nodiscard]] Quad quad_of(const cv::Rect2f& box);

// The homography that maps `from` to `to`, exact for the four corners. Degenerate quads give the
// identity.
[[nodiscard]] cv::Matx33d map_between(const Quad& from, const Quad& to);

[[nodiscard]] cv::Point2f transformed(const cv::Matx33d& map, cv::Point2f point);
[[nodiscard]] Quad transformed(const cv::Matx33d& map, const Quad& quad);

// Area by the shoelace formula, px^2; negative if the corners run counter-clockwise in the image.
[[nodiscard]] float area(const Quad& quad);
// Mean length of the top and bottom sides, and of the left and right sides.
[[nodiscard]] float mean_width(const Quad& quad);
[[nodiscard]] float mean_height(const Quad& quad);

// Returns whether the quad is convex, clockwise and finite, with an area of at least `min_area`
// px^2.
[[nodiscard]] bool is_convex(const Quad& quad, float min_area);

// Scales the quad about its centre by these factors along its own axes (bilinear).
[[nodiscard]] Quad grow(const Quad& quad, float along, float across);

// Part of a quad: left, right, top, bottom in 0..1 of its own (projective) coordinates.
[[nodiscard]] Quad part_of(const Quad& quad, float left, float right, float top, float bottom);

// Intersection over union of the upright boxes around two quads.
[[nodiscard]] float box_iou(const Quad& a, const Quad& b);

// Area of the intersection of the upright boxes, divided by the area of the smaller box.
[[nodiscard]] float box_overlap_of_smaller(const Quad& a, const Quad& b);

// Warps the image into a canvas in which `in_image` lies at `in_canvas`; CV_8UC1 in and out. If the
// image is much larger than the canvas, pixels are averaged, not sub-sampled. Outside the image the
// edge pixels are repeated.
[[nodiscard]] cv::Mat sample(const cv::Mat& gray, const Quad& in_image, const Quad& in_canvas,
                             cv::Size canvas);

}  // namespace tarsier::plate
