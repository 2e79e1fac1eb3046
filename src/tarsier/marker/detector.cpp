// SPDX-License-Identifier: MIT
#include "tarsier/marker/detector.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>

namespace tarsier::marker {
namespace {

Eigen::Vector2d center_of(const Quad& quad) { return (quad[0] + quad[1] + quad[2] + quad[3]) / 4; }

double size_of(const Quad& quad) { return (quad[0] - quad[2]).norm() / std::sqrt(2.0); }

// The outer side is the larger one; of like sides the clearer reading.
bool is_better(const Marker& a, const Marker& b) {
  if (a.reading.match.errors != b.reading.match.errors)
    return a.reading.match.errors < b.reading.match.errors;
  return a.reading.margin > b.reading.margin;
}

}  // namespace

void DetectOptions::check() const {
  quads.check();
  refine.check();
  decode.check();
  TARSIER_REQUIRE(min_margin >= 0 && min_margin < 1, "a margin of {}", min_margin);
}

std::vector<Marker> detect_markers(const cv::Mat& gray, const Dictionary& dictionary,
                                   const DetectOptions& options, DetectWorkspace& workspace) {
  options.check();
  std::vector<Marker> markers;
  for (const Quad& candidate : find_quads(gray, options.quads, workspace.quads)) {
    Quad quad = candidate;
    // The contour runs along dark pixels: the edge is a little outside of it.
    RefineOptions refine = options.refine;
    const double cell = size_of(quad) / (dictionary.cells() + 2);
    refine.reach_px = std::clamp(0.6 * cell, 1.5, options.refine.reach_px);
    if (!refine_quad(gray, refine, quad)) continue;
    const auto reading = read_quad(gray, quad, dictionary, options.decode);
    if (!reading || reading->margin < options.min_margin) continue;
    // Once more, from where the edges are.
    refine.reach_px = std::min(refine.reach_px, 2.0);
    static_cast<void>(refine_quad(gray, refine, quad));
    Marker marker;
    marker.id = reading->match.id;
    marker.reading = *reading;
    // Turned anticlockwise by `rotation` quarters the cells match: the marker's own top left lies
    // that many corners further on.
    for (std::size_t k = 0; k < 4; ++k)
      marker.corners[k] = quad[(k + static_cast<std::size_t>(reading->match.rotation)) % 4];
    const auto same = std::find_if(markers.begin(), markers.end(), [&](const Marker& other) {
      return (center_of(other.corners) - center_of(quad)).norm() <
             0.5 * std::min(size_of(other.corners), size_of(quad));
    });
    if (same == markers.end())
      markers.push_back(std::move(marker));
    else if (is_better(marker, *same))
      *same = std::move(marker);
  }
  std::stable_sort(markers.begin(), markers.end(),
                   [](const Marker& a, const Marker& b) { return a.id < b.id; });
  return markers;
}

}  // namespace tarsier::marker
