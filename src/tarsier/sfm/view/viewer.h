// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <string>

// A reconstruction as a page for a browser that needs nothing but itself: no network, no files.
namespace tarsier::sfm {

// The whole page. Drag turns, the wheel or two fingers zoom, shift-drag or the right button moves,
// double click resets; cameras show their names. Drawn by WebGL, or as plain canvas with up to
// 15000 points where there is none. Fit for <iframe srcdoc>: there, the wheel scrolls the page
// until the view is clicked. Names and title may hold any bytes. Of more than `max_points` (>= 1)
// points that many are drawn, spread evenly; so are only those within 8 radii of the middle. About
// 12 bytes a point.
[[nodiscard]] std::string viewer_html(const Model& model, const std::string& title,
                                      int max_points = 60000);

// The same for the inside of another page's body: one <div class="tv"> with its own style and
// script, as wide as its place. Several of them may stand on one page.
[[nodiscard]] std::string viewer_fragment(const Model& model, const std::string& title,
                                          int max_points = 60000);

}  // namespace tarsier::sfm
