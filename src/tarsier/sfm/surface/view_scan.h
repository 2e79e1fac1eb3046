// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/dense/workspace.h"
#include "tarsier/sfm/surface/surface_mesh.h"

#include <opencv2/core/mat.hpp>

#include <array>
#include <stop_token>
#include <vector>

// Which images show a face, and how well.
namespace tarsier::sfm {

// z of what each pixel of `camera` sees of the surface; infinity: nothing. Every pixel whose middle is in a
// face, or on its edge.
[[nodiscard]] cv::Mat1f depth_of_surface(const SurfaceMesh& mesh, const geometry::Camera& camera,
                                         const geometry::Rigid3& pose);

struct FaceView {
  int view = -1;      // of the workspace; -1: none
  float quality = 0;  // px^2 of the face in the image, times the cosine of its angle
};
inline constexpr std::size_t kFaceViews = 8;
using FaceViews = std::array<FaceView, kFaceViews>;  // best first

struct ViewScan {
  std::vector<FaceViews> faces;
  std::vector<cv::Vec3b>
      colors;            // of vertices, BGR: mean of the images, weighted by quality squared
  int unseen_faces = 0;  // that no image shows whole
  // Vertices that no image shows; they have the colours of those around them, or grey.
  int unseen_vertices = 0;
};

// An image shows a point that is in it (2 px from its border), on a face that looks at the camera
// (85 degrees at most), and not farther than `tolerance` (world units) behind the surface's depth
// there, nor within 2 px of a dark background (dark_background.h). A face is shown whose corners and middle are. Images are read one by one. Throws InputError,
// Interrupted.
[[nodiscard]] ViewScan scan_views(const Workspace& workspace, const SurfaceMesh& mesh,
                                  double tolerance, int dark_level, Progress& progress,
                                  const std::stop_token& stop);

// One view for each face, -1 for those that none shows: large parts with one view each, for each
// seam between two may be seen. Views are taken in turn, the one first that shows the largest area
// well (0.7 of the best quality) that has none yet; then faces change to a neighbour's view where
// 1 - quality / best + 0.35 * neighbours with another view becomes smaller (iterated conditional
// modes: Besag 1986), and parts of a few faces join one beside them.
[[nodiscard]] std::vector<int> choose_views(const SurfaceMesh& mesh, const ViewScan& scan,
                                            int views);

// Bilinear, BGR 0..255; outside the border goes on.
[[nodiscard]] cv::Vec3f color_at(const cv::Mat& bgr, const cv::Point2d& pixel);

}  // namespace tarsier::sfm
