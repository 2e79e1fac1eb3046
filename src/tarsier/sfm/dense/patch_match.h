// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"

#include <opencv2/core.hpp>

#include <cstdint>
#include <stop_token>
#include <vector>

// The depth of every pixel of an image, from other images whose poses are known.
//
// Each pixel has a plane, depth and normal, and the plane says where the pixels around it appear in
// another image (a homography). How well a patch of 11x11 px agrees there is one minus its
// normalised cross-correlation, weighted by likeness in the reference (patch_kernels.h). Good planes
// spread to pixels around them, and each pixel changes its own at random and keeps what is better
// (PatchMatch: Barnes and others, SIGGRAPH 2009; with slanted planes: Bleyer, Rhemann and Rother,
// BMVC 2011). All pixels of one colour of a checkerboard go at once (Galliani, Lasinger and Schindler,
// ICCV 2015) and look for good planes near and far in four directions (Xu and Tao, CVPR 2019). Of the
// sources those count in which a pixel and its neighbours are seen well (after Schoenberger and
// others, ECCV 2016). At full size patches with enough texture are 4 px wide and looked at in larger images, if
// there are some, so that relief narrower than a patch is followed. It begins at a quarter of the size, with planes through known points, so that
// weak texture is decided by what is around it.
namespace tarsier::sfm {

struct PatchMatchOptions {
  int levels = 3;            // scales, each half as large as the one before
  int coarse_rounds = 4;     // of propagation, at the smallest scale
  int middle_rounds = 2;     // at those between
  int fine_rounds = 1;       // at full size
  int geometric_rounds = 1;  // with the depths of the sources
  int best_views = 3;        // sources that decide for a pixel

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
  geometry::Camera camera;  // of this size, without distortion
  geometry::Rigid3 pose;    // camera_from_world
  cv::Mat1f depth;          // of a source, where it is known; 0: unknown; empty: not at all
  cv::Mat1b large = {};     // the same image, larger, for fine relief; empty: there is none
};

// A point of which the depth is known: px of the reference, z in its camera.
struct KnownDepth {
  cv::Point2d pixel;
  double depth = 0;
};

struct MatchProblem {
  MatchImage reference;
  std::vector<MatchImage> sources;  // 1..16
  double min_depth = 0;             // > 0
  double max_depth = 0;             // > min_depth
  std::vector<KnownDepth> known;    // where planes begin; may be empty
  std::uint64_t seed = 0;

  // Throws std::invalid_argument.
  void check() const;
};

struct PlaneMap {
  cv::Mat1f depth;   // z, of each pixel, within the range
  cv::Mat3f normal;  // unit, in the camera's frame, towards the camera
  // 0..2: weighted mean over the best sources, with 0.2 for each px of reprojection error (3 at most)
  // where their depths are known.
  cv::Mat1f cost;
};

// From the images alone. Not thread-safe with respect to cv::setNumThreads; uses its threads; the
// result does not depend on their number. Throws Interrupted; std::invalid_argument.
[[nodiscard]] PlaneMap match_planes(const MatchProblem& problem, const PatchMatchOptions& options,
                                    const std::stop_token& stop = {});

// Goes over a map again, with the depths of the sources: a plane costs what its point is off when it is
// carried to the source and back, 0.2 for each px.
[[nodiscard]] PlaneMap match_again(const MatchProblem& problem, const PlaneMap& start,
                                   const PatchMatchOptions& options,
                                   const std::stop_token& stop = {});

// Bytes that a problem of so many px, and so many of its larger images, with so many sources
// needs, about.
[[nodiscard]] std::int64_t matching_bytes(std::int64_t pixels, std::int64_t large_pixels,
                                          int sources);

}  // namespace tarsier::sfm
