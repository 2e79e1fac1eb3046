// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/dense/workspace.h"
#include "tarsier/sfm/surface/surface_mesh.h"

#include <opencv2/core/mat.hpp>

#include <stop_token>
#include <vector>

namespace tarsier::sfm {

// An image that is laid over a surface.
struct SurfaceTexture {
  cv::Mat image;               // CV_8UC3 BGR
  std::vector<cv::Vec2f> uvs;  // (0, 0): the bottom left corner of the image, (1, 1): its top right
  std::vector<Face> corners;   // of each face of the surface: indices of uvs
  int charts = 0;              // connected parts with one view each
  double scale = 1;            // pixels of the texture for one of the images
};

struct TextureJob {
  const Workspace& workspace;
  const SurfaceMesh& mesh;        // with colours, for faces without a view
  const std::vector<int>& views;  // of each face; -1: none
  int size = 4096;                // px, largest side
  bool level = true;              // seams
};
// Connected faces of one view are a chart: they keep the place that they have in the image, so that its pixels are
// copied, not resampled, unless all charts together are too large; then all are reduced by the same
// factor. Faces that no image shows have small triangles of their own, in the colours of their
// corners. Seams are levelled (seam_levelling.h). Around each chart the image goes on for three
// pixels. Each image is read once. The same for any number of threads. Throws InputError,
// Interrupted, UsageError where the texture is too small for the charts.
[[nodiscard]] SurfaceTexture make_surface_texture(const TextureJob& job, Progress& progress,
                                                  const std::stop_token& stop);

}  // namespace tarsier::sfm
