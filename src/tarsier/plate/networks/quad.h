// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/text/reading.h"

#include <opencv2/core.hpp>

// Geometry of quadrilaterals in images. Pixel centres lie at whole numbers.
namespace tarsier::plate {

[[nodiscard]] Quad quad_of(const cv::Rect2f& box);

// The projective map that takes `from` to `to` (exact for the four corners). Degenerate quads give
// the identity.
[[nodiscard]] cv::Matx33d map_between(const Quad& from, const Quad& to);

[[nodiscard]] cv::Point2f transformed(const cv::Matx33d& map, cv::Point2f point);
[[nodiscard]] Quad transformed(const cv::Matx33d& map, const Quad& quad);

// Area by the shoelace formula, px^2; negative when the corners run counter-clockwise in the image.
[[nodiscard]] float area(const Quad& quad);
// Mean of the lengths of top and bottom, and of left and right.
[[nodiscard]] float mean_width(const Quad& quad);
[[nodiscard]] float mean_height(const Quad& quad);

// A sane quad: convex, clockwise, finite, its area at least `least` px^2.
[[nodiscard]] bool is_convex(const Quad& quad, float least);

// Corners moved from the centre by these factors along the quad's own axes (bilinear).
[[nodiscard]] Quad grow(const Quad& quad, float along, float across);

// Part of a quad: left, right, top, bottom in 0..1 of its own (projective) coordinates.
[[nodiscard]] Quad part_of(const Quad& quad, float left, float right, float top, float bottom);

// Intersection over union of the upright boxes around two quads.
[[nodiscard]] float box_iou(const Quad& a, const Quad& b);

// Intersection of the upright boxes over the smaller of them.
[[nodiscard]] float box_overlap_of_smaller(const Quad& a, const Quad& b);

// The image as seen in a canvas in which `in_image` lies at `in_canvas`; CV_8UC1 in and out.
// Images much larger than the canvas are averaged, not sub-sampled. Outside the image its edge
// goes on.
[[nodiscard]] cv::Mat sample(const cv::Mat& gray, const Quad& in_image, const Quad& in_canvas,
                             cv::Size canvas);

}  // namespace tarsier::plate
