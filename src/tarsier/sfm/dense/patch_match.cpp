// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/patch_match.h"

#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/dense/depth_map.h"
#include "tarsier/sfm/dense/known_planes.h"
#include "tarsier/sfm/dense/plane_sweeper.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::sfm {
namespace {

constexpr int kMinSide = 64;            // px, of the smallest scale
constexpr int kRandomPlanes = 3;        // initial random planes per pixel of the smallest scale
constexpr float kInitialMotion_px = 4;  // px, of the first changes of a plane
constexpr float kRefinementStep_px = 0.25F;  // px, of the last refinement

cv::Mat1b reduced(const cv::Mat1b& gray, int level) {
  if (level == 0) return gray;
  const int part = 1 << level;
  const cv::Size size((gray.cols + part - 1) / part, (gray.rows + part - 1) / part);
  cv::Mat1b smaller;
  cv::resize(gray, smaller, size, 0, 0, cv::INTER_AREA);
  return smaller;
}

cv::Mat1f inverse_of(const cv::Mat1f& depth) {
  cv::Mat1f inverse(depth.size());
  for (int y = 0; y < depth.rows; ++y)
    for (int x = 0; x < depth.cols; ++x) inverse(y, x) = depth(y, x) > 0 ? 1 / depth(y, x) : 0.F;
  return inverse;
}

MatchLevel make_level(const MatchProblem& problem, int level, bool with_depths) {
  MatchLevel result;
  result.gray = reduced(problem.reference.gray, level);
  result.camera = camera_of_map(problem.reference.camera, result.gray.size());
  result.min_inverse_depth = static_cast<float>(1 / problem.max_depth);
  result.max_inverse_depth = static_cast<float>(1 / problem.min_depth);
  for (const MatchImage& image : problem.sources) {
    const cv::Mat1b gray = reduced(image.gray, level);
    result.sources.push_back(make_source(gray, camera_of_map(image.camera, gray.size()),
                                         image.pose * problem.reference.pose.inverse(),
                                         result.camera));
    if (with_depths && !image.depth.empty())
      result.sources.back().inverse_depth = inverse_of(image.depth);
  }
  return result;
}

// Adds the larger images; images without one are used as they are.
void add_large_images(const MatchProblem& problem, MatchLevel& level) {
  const auto gray_of = [](const MatchImage& image) -> const cv::Mat1b& {
    return image.large.empty() ? image.gray : image.large;
  };
  const cv::Mat1b& reference_gray = gray_of(problem.reference);
  level.large_words = gray_words(reference_gray);
  level.large_size = reference_gray.size();
  for (const MatchImage& image : problem.sources) {
    const cv::Mat1b& gray = gray_of(image);
    level.large_sources.push_back(make_source(gray, camera_of_map(image.camera, gray.size()),
                                              image.pose * problem.reference.pose.inverse(),
                                              level.camera));
  }
}

PlaneMap map_of(const MatchLevel& level, const PlaneField& field) {
  PlaneMap map{cv::Mat1f(field.size), cv::Mat3f(field.size), cv::Mat1f(field.size)};
  for (int y = 0; y < field.size.height; ++y) {
    for (int x = 0; x < field.size.width; ++x) {
      const std::size_t i = field.index(x, y);
      map.depth(y, x) = 1 / field.planes[i].inverse_depth;
      map.normal(y, x) = normal_of(level.camera, x, y, field.planes[i]);
      map.cost(y, x) = field.costs[i];
    }
  }
  return map;
}

PlaneSweeper::Options sweeper_options(const MatchProblem& problem, const PatchMatchOptions& options,
                                      int level) {
  PlaneSweeper::Options result;
  result.best_views = options.best_views;
  result.seed = problem.seed * 64 + static_cast<std::uint64_t>(level);
  return result;
}

void run_rounds(PlaneSweeper& sweeper, int rounds, float motion, const std::stop_token& stop) {
  for (int round = 0; round < rounds; ++round) {
    sweeper.sweep(round, motion, 4, stop);
    motion = std::max(motion / 2, 0.25F);
  }
}

void check_image(const MatchImage& image, const char* what) {
  image.camera.check();
  TARSIER_REQUIRE(!image.gray.empty() && image.gray.cols == image.camera.width &&
                      image.gray.rows == image.camera.height,
                  "{}: an image of {}x{} px with a camera of {}x{} px", what, image.gray.cols,
                  image.gray.rows, image.camera.width, image.camera.height);
  TARSIER_REQUIRE(image.gray.cols >= 16 && image.gray.rows >= 16,
                  "{}: {}x{} px, expected 16x16 or more", what, image.gray.cols, image.gray.rows);
  TARSIER_REQUIRE(!image.camera.is_distorted(), "{}: the camera has lens distortion", what);
  TARSIER_REQUIRE(image.depth.empty() || image.depth.size() == image.gray.size(),
                  "{}: depths of {}x{}", what, image.depth.cols, image.depth.rows);
  TARSIER_REQUIRE(image.large.empty() ||
                      (image.large.cols >= image.gray.cols && image.large.rows >= image.gray.rows),
                  "{}: a larger image of {}x{}", what, image.large.cols, image.large.rows);
  image.pose.check();
}

}  // namespace

void MatchProblem::check() const {
  check_image(reference, "reference");
  TARSIER_REQUIRE(!sources.empty() && sources.size() <= kMaxSources, "{} sources", sources.size());
  for (const MatchImage& source : sources) check_image(source, "source");
  TARSIER_REQUIRE(min_depth > 0 && max_depth > min_depth && std::isfinite(max_depth),
                  "depths {}..{}", min_depth, max_depth);
}

PlaneMap match_planes(const MatchProblem& problem, const PatchMatchOptions& options,
                      const std::stop_token& stop) {
  problem.check();
  options.check();
  int min_side = std::min(problem.reference.gray.cols, problem.reference.gray.rows);
  for (const MatchImage& source : problem.sources)
    min_side = std::min({min_side, source.gray.cols, source.gray.rows});
  int top = options.levels - 1;
  while (top > 0 && (min_side >> top) < kMinSide) --top;

  PlaneField field;
  for (int l = top; l >= 0; --l) {
    throw_if_stopped(stop);
    MatchLevel level = make_level(problem, l, false);
    if (l == 0) add_large_images(problem, level);
    const bool is_first = l == top;
    if (is_first) {
      field = PlaneField(level.gray.size(), static_cast<int>(problem.sources.size()));
      field.planes = known_planes(problem, level.camera);
    } else {
      field = enlarged(field, level.gray.size());
    }
    PlaneSweeper sweeper(level, field, sweeper_options(problem, options, l));
    sweeper.score(stop);
    if (is_first) sweeper.try_random(kRandomPlanes, stop);
    const int rounds = is_first ? options.coarse_rounds
                       : l > 0  ? options.middle_rounds
                                : options.fine_rounds;
    run_rounds(sweeper, rounds, is_first ? kInitialMotion_px : 1, stop);
    if (l == 0) {
      sweeper.refine(kRefinementStep_px, stop);
      return map_of(level, field);
    }
  }
  return {};  // unreachable: level 0 returns
}

PlaneMap refine_planes(const MatchProblem& problem, const PlaneMap& start,
                       const PatchMatchOptions& options, const std::stop_token& stop) {
  problem.check();
  options.check();
  TARSIER_REQUIRE(start.depth.size() == problem.reference.gray.size() &&
                      start.normal.size() == start.depth.size(),
                  "an initial map of {}x{}", start.depth.cols, start.depth.rows);
  MatchLevel level = make_level(problem, 0, true);
  add_large_images(problem, level);
  PlaneField field(level.gray.size(), static_cast<int>(problem.sources.size()));
  for (int y = 0; y < field.size.height; ++y) {
    for (int x = 0; x < field.size.width; ++x) {
      field.planes[field.index(x, y)] =
          start.depth(y, x) > 0
              ? plane_of(level.camera, x, y, 1 / start.depth(y, x), start.normal(y, x))
              : Plane{level.min_inverse_depth, 0, 0};
    }
  }
  PlaneSweeper sweeper(level, field, sweeper_options(problem, options, 63));
  sweeper.score(stop);
  run_rounds(sweeper, options.geometric_rounds, 0.5F, stop);
  sweeper.refine(kRefinementStep_px, stop);
  return map_of(level, field);
}

std::int64_t matching_bytes(std::int64_t pixels, std::int64_t large_pixels, int sources) {
  // Planes, costs and the map; words, grey levels, depths and costs of each source. Enlarged data
  // exist twice. For each larger image: words and grey levels.
  return pixels * (12 + 4 + 20 + 8 + 13 + static_cast<std::int64_t>(sources) * (4 + 1 + 8 + 2)) +
         large_pixels * (static_cast<std::int64_t>(sources) + 1) * (4 + 1);
}

}  // namespace tarsier::sfm
