// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <Eigen/Core>
#include <opencv2/core/matx.hpp>

#include <cstdint>
#include <string>
#include <vector>

// A reconstruction as a self-contained page for a browser, without network or other files.
namespace tarsier::sfm {

// Layers besides the points and cameras of the model, each with its own button. World units.
// Numbers that are not finite, and points farther than 8 radii from the centre, are not drawn.
struct ViewerCloud {
  std::vector<Eigen::Vector3f> positions;
  std::vector<cv::Vec3b> colors;  // BGR, equally many
};
struct ViewerSurface {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<cv::Vec3b> colors;       // BGR, for each vertex
  std::vector<std::uint32_t> indices;  // of vertices, three per face
  std::vector<cv::Vec2f> uvs;          // for each vertex, (0, 0): top left of the texture; or empty
  std::string texture;                 // content of a JPEG file; empty: colours are used
};
struct ViewerLayers {
  ViewerCloud cloud;      // empty: none
  ViewerSurface surface;  // without indices: none
};

// The complete page. Dragging rotates, the wheel or two fingers zoom, shift-drag or the right
// button moves, a double click resets; cameras show their names. Measure takes two clicks and shows
// their distance in units of the model. Cut hides everything outside of a box with six sliders.
// Drawn by WebGL, or without it on a plain canvas with up to 15000 points. Suitable for <iframe
// srcdoc>: there, the wheel scrolls the page until the view is clicked. Names and title may contain
// any bytes. At most `max_points` (>= 1) points are drawn, evenly selected, and only those within 8
// radii of the centre. About 12 bytes per point.
[[nodiscard]] std::string viewer_html(const Model& model, const std::string& title,
                                      int max_points = 60000);
// With layers: the surface is shown first, else the cloud. At most 400 000 points of a cloud are
// drawn. Throws std::invalid_argument where sizes are inconsistent or an index is out of range.
[[nodiscard]] std::string viewer_html(const Model& model, const std::string& title,
                                      const ViewerLayers& layers, int max_points = 60000);

}  // namespace tarsier::sfm
