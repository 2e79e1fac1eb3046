// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/dense/workspace.h"
#include "tarsier/sfm/surface/surface_mesh.h"

#include <opencv2/core/mat.hpp>

#include <array>
#include <stop_token>
#include <vector>

// Determines which images show a face, and how well.
namespace tarsier::sfm {

// The z of the surface at each pixel of `camera`; infinity: none. A pixel counts where its centre
// is in a face or on its edge.
[[nodiscard]] cv::Mat1f depth_of_surface(const SurfaceMesh& mesh, const geometry::Camera& camera,
                                         const geometry::Rigid3& pose);

struct FaceView {
  int view = -1;      // index in the workspace; -1: none
  float quality = 0;  // px^2 of the face in the image, times the cosine of its angle
};
inline constexpr std::size_t kFaceViews = 8;
using FaceViews = std::array<FaceView, kFaceViews>;  // best first

struct ViewScan {
  std::vector<FaceViews> faces;
  // for each vertex, BGR: mean of the images, weighted by quality squared
  std::vector<cv::Vec3b> colors;
  int unseen_faces = 0;  // faces that no image shows completely
  // Vertices that no image shows. They have the colours of their surroundings, or grey.
  int unseen_vertices = 0;
};

// An image shows a point that is at least 2 px inside its border, on a face whose angle to the
// camera is at most 85 degrees. The point must not be farther than `tolerance` (world units) behind
// the surface's depth there, or within 2 px of a dark background (dark_background.h). A face is
// shown if its corners and its centre are. Images are read one by one. Throws InputError,
// Interrupted.
[[nodiscard]] ViewScan scan_views(const Workspace& workspace, const SurfaceMesh& mesh,
                                  double tolerance, int dark_level, Progress& progress,
                                  const std::stop_token& stop);

// Chooses one view for each face, -1 for faces that none shows. The aim is large parts with the
// same view, since seams between parts may be visible. Views are assigned greedily: the next is the
// one that shows the largest remaining area well (with 0.7 of the best quality). Then faces change
// to a neighbour's view where that reduces 1 - quality / best + 0.35 * neighbours with another view
// (iterated conditional modes: Besag 1986). At the end, small parts join an adjacent one.
[[nodiscard]] std::vector<int> choose_views(const SurfaceMesh& mesh, const ViewScan& scan,
                                            int views);

// Bilinear, BGR 0..255; outside the image its border is replicated.
[[nodiscard]] cv::Vec3f color_at(const cv::Mat& bgr, const cv::Point2d& pixel);

}  // namespace tarsier::sfm
