// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/dense/workspace.h"
#include "tarsier/sfm/surface/surface_mesh.h"

#include <opencv2/core/mat.hpp>

#include <stop_token>
#include <vector>

namespace tarsier::sfm {

// A texture for a surface.
struct SurfaceTexture {
  cv::Mat image;               // CV_8UC3 BGR
  std::vector<cv::Vec2f> uvs;  // (0, 0): bottom left corner of the image, (1, 1): top right
  std::vector<Face> corners;   // for each face of the surface: indices of uvs
  int charts = 0;              // connected parts with one view each
  double scale = 1;            // px of the texture per px of the images
};

struct TextureJob {
  const Workspace& workspace;
  const SurfaceMesh& mesh;        // with colours, for faces without a view
  const std::vector<int>& views;  // for each face; -1: none
  int size = 4096;                // px, longest side
  bool level = true;              // level the seams
};
// Connected faces with the same view form a chart. A chart keeps its shape in the image, so that
// pixels are copied and not resampled. Where all charts together are too large, all are reduced by
// the same factor. Faces that no image shows get small triangles of their own, in the colours of
// their corners. Seams are levelled (seam_levelling.h). Each chart includes three px of the image
// around it. Each image is read once. Does not depend on the number of threads. Throws InputError,
// Interrupted, UsageError where the texture is too small for the charts.
[[nodiscard]] SurfaceTexture make_surface_texture(const TextureJob& job, Progress& progress,
                                                  const std::stop_token& stop);

}  // namespace tarsier::sfm
