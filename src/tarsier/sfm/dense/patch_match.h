// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"

#include <opencv2/core.hpp>

#include <cstdint>
#include <stop_token>
#include <vector>

// Computes the depth of every pixel of an image from other images with known poses.
//
// Each pixel has a plane, i.e. depth and normal. The plane maps the pixel's surroundings to another
// image (a homography). The cost of a patch of 11x11 px is one minus its normalised
// cross-correlation there, weighted by similarity in the reference (patch_kernels.h). Good planes
// are propagated to surrounding pixels, and each pixel randomly changes its own plane and keeps the
// better one (PatchMatch: Barnes and others, SIGGRAPH 2009; with slanted planes: Bleyer, Rhemann
// and Rother, BMVC 2011).
//
// All pixels of one colour of a checkerboard are updated together (Galliani, Lasinger and
// Schindler, ICCV 2015), and search good planes near and far in four directions (Xu and Tao, CVPR
// 2019). Of the sources, those count that see a pixel and its neighbours well (after Schoenberger
// and others, ECCV 2016). At full size, patches with enough texture are 4 px wide and compared in
// larger images, where available, so that relief narrower than a patch is resolved. Matching starts
// at a quarter of the size with planes through known points, so that the surroundings decide where
// texture is weak.
namespace tarsier::sfm {

struct PatchMatchOptions {
  int levels = 3;            // scales, each half as large as the previous one
  int coarse_rounds = 4;     // propagation rounds at the smallest scale
  int middle_rounds = 2;     // rounds at the scales between
  int fine_rounds = 1;       // rounds at full size
  int geometric_rounds = 1;  // rounds with the depths of the sources
  int best_views = 3;        // number of sources that are used for a pixel

  [[nodiscard]] OptionFields fields() {
    return {{"levels", levels, range(1, 6)},
            {"coarse_rounds", coarse_rounds, range(1, 50)},
            {"middle_rounds", middle_rounds, range(1, 50)},
            {"fine_rounds", fine_rounds, range(0, 50)},
            {"geometric_rounds", geometric_rounds, range(0, 50)},
            {"best_views", best_views, range(1, 16)}};
  }
  void check() const { check_fields(*this); }
};

struct MatchImage {
  cv::Mat1b gray;
  geometry::Camera camera;  // of this size, undistorted
  geometry::Rigid3 pose;    // camera_from_world
  cv::Mat1f depth;          // of a source; 0: unknown; empty: not available
  cv::Mat1b large = {};     // the same image, larger, for fine relief; empty: not available
};

// A point of known depth: px of the reference, z in its camera.
struct KnownDepth {
  cv::Point2d pixel;
  double depth = 0;
};

struct MatchProblem {
  MatchImage reference;
  std::vector<MatchImage> sources;  // 1..16
  double min_depth = 0;             // > 0
  double max_depth = 0;             // > min_depth
  std::vector<KnownDepth> known;    // initial planes; may be empty
  std::uint64_t seed = 0;

  // Throws std::invalid_argument.
  void check() const;
};

struct PlaneMap {
  cv::Mat1f depth;   // z of each pixel, within the range
  cv::Mat3f normal;  // unit, in the camera frame, pointing to the camera
  // 0..2: weighted mean over the best sources, plus 0.2 per px of reprojection error (at most 3 px)
  // where their depths are known.
  cv::Mat1f cost;
};

// Matches by the images alone. Uses the threads of OpenCV; must not run while cv::setNumThreads()
// is called. The result does not depend on the number of threads. Throws Interrupted;
// std::invalid_argument.
[[nodiscard]] PlaneMap match_planes(const MatchProblem& problem, const PatchMatchOptions& options,
                                    const std::stop_token& stop = {});

// Refines a map with the depths of the sources. The cost of a plane includes 0.2 per px of the
// error of its point after projection to the source and back.
[[nodiscard]] PlaneMap refine_planes(const MatchProblem& problem, const PlaneMap& start,
                                     const PatchMatchOptions& options,
                                     const std::stop_token& stop = {});

// Approximate memory in bytes for a problem with this many px, px of its larger images, and
// sources.
[[nodiscard]] std::int64_t matching_bytes(std::int64_t pixels, std::int64_t large_pixels,
                                          int sources);

}  // namespace tarsier::sfm
