// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <Eigen/Core>
#include <opencv2/core/matx.hpp>

#include <cstdint>
#include <string>
#include <vector>

// A reconstruction as a page for a browser that needs nothing but itself: no network, no files.
namespace tarsier::sfm {

// What the page shows beside the points and cameras of the model, each with a button of its own.
// World units; what is not finite, or further than 8 radii from the middle, is not drawn.
struct ViewerCloud {
  std::vector<Eigen::Vector3f> positions;
  std::vector<cv::Vec3b> colors;  // BGR, as many
};
struct ViewerSurface {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<cv::Vec3b> colors;       // BGR, of each vertex
  std::vector<std::uint32_t> indices;  // of vertices, three a face
  std::vector<cv::Vec2f> uvs;          // of each vertex, (0, 0): the texture's top left; or empty
  std::string texture;                 // a JPEG file's bytes; empty: the colours are drawn
};
struct ViewerLayers {
  ViewerCloud cloud;      // empty: none
  ViewerSurface surface;  // without indices: none
};

// The whole page. Drag turns, the wheel or two fingers zoom, shift-drag or the right button moves,
// double click resets; cameras show their names. Measure takes two clicks and says their distance in units of the
// model; Cut hides all outside of a box with six sliders. Drawn by WebGL, or as plain canvas with up to
// 15000 points where there is none. Fit for <iframe srcdoc>: there, the wheel scrolls the page
// until the view is clicked. Names and title may hold any bytes. Of more than `max_points` (>= 1)
// points that many are drawn, spread evenly; so are only those within 8 radii of the middle. About
// 12 bytes a point.
[[nodiscard]] std::string viewer_html(const Model& model, const std::string& title,
                                      int max_points = 60000);
// With layers: the surface is shown first, else the cloud. Of a cloud of more than 400 000 points that many are drawn. Throws
// std::invalid_argument where numbers do not fit together or an index is out of range.
[[nodiscard]] std::string viewer_html(const Model& model, const std::string& title,
                                      const ViewerLayers& layers, int max_points = 60000);

// The same for the inside of another page's body: one <div class="tv"> with its own style and
// script, as wide as its place. Several of them may stand on one page.
[[nodiscard]] std::string viewer_fragment(const Model& model, const std::string& title,
                                          int max_points = 60000);

}  // namespace tarsier::sfm
