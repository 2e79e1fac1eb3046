// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/patch_match.h"

#include "tarsier/core/cpu.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/sfm/dense/depth_filter.h"
#include "tarsier/sfm/dense/patch_kernels.h"
#include "tarsier/sfm/dense/plane_field.h"
#include "tarsier/synth/sfm_scene.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <stop_token>

namespace tarsier::sfm {
namespace {

struct SyntheticScene {
  explicit SyntheticScene(synth::Content content) : scene(options_of(content)) {
    for (int i = 0; i < scene.count(); ++i) {
      cv::Mat1b gray;
      cv::cvtColor(scene.render(i), gray, cv::COLOR_BGR2GRAY);
      images.push_back({gray, scene.camera(), scene.pose(i), {}});
    }
  }
  static synth::SceneOptions options_of(synth::Content content) {
    synth::SceneOptions options;
    options.size = {240, 180};
    options.images = 4;
    options.noise = 1;
    options.content = content;
    return options;
  }
  [[nodiscard]] MatchProblem problem(std::size_t reference) const {
    MatchProblem problem;
    problem.reference = images[reference];
    for (std::size_t i = 0; i < images.size(); ++i)
      if (i != reference) problem.sources.push_back(images[i]);
    problem.min_depth = 6;
    problem.max_depth = 16;
    return problem;
  }
  [[nodiscard]] cv::Mat1f truth(std::size_t index) const {
    cv::Mat1f depth(images[index].gray.size());
    for (int y = 0; y < depth.rows; ++y)
      for (int x = 0; x < depth.cols; ++x)
        depth(y, x) =
            static_cast<float>(scene.depth(static_cast<int>(index), cv::Point2d(x, y)).value_or(0));
    return depth;
  }

  synth::SfmScene scene;
  std::vector<MatchImage> images;
};

const SyntheticScene& relief() {
  static const SyntheticScene scene(synth::Content::kRelief);
  return scene;
}

// Sorted relative errors of the depths that both maps have.
std::vector<float> errors_of(const cv::Mat1f& depth, const cv::Mat1f& truth) {
  std::vector<float> errors;
  for (int y = 0; y < depth.rows; ++y)
    for (int x = 0; x < depth.cols; ++x)
      if (depth(y, x) > 0 && truth(y, x) > 0)
        errors.push_back(std::abs(depth(y, x) / truth(y, x) - 1));
  std::sort(errors.begin(), errors.end());
  return errors;
}

TEST(PatchKernels, AgreeBetweenInstructionSets) {
  const SyntheticScene& scene = relief();
  const MatchProblem problem = scene.problem(1);
  const SourceLevel source =
      make_source(problem.sources[0].gray, problem.sources[0].camera, {}, problem.reference.camera);
  const cv::Mat1b& gray = problem.reference.gray;
  const GrayImage image{gray.ptr(), static_cast<std::int64_t>(gray.step[0]), gray.cols, gray.rows};
  Rng rng(3);
  for (int i = 0; i < 300; ++i) {
    const int x = rng.integer(0, gray.cols - 1);
    const int y = rng.integer(0, gray.rows - 1);
    const float h[9] = {static_cast<float>(x + rng.uniform(-9, 9)),
                        1.02F,
                        0.1F,
                        static_cast<float>(y + rng.uniform(-9, 9)),
                        -0.1F,
                        0.97F,
                        1,
                        1e-3F,
                        static_cast<float>(rng.uniform(-0.02, 0.02))};
    Patch patch;
    patch_kernels_baseline()->prepare(image, x, y, patch);
    const float expected = patch_kernels_baseline()->cost(patch, source.quads(), h);
    EXPECT_GE(expected, 0);
    EXPECT_LE(expected, kMaxCost);
    for (const PatchKernels* kernels : {patch_kernels_avx2(), patch_kernels_avx512()}) {
      const bool is_avx2 = kernels == patch_kernels_avx2();
      if (kernels == nullptr ||
          hardware_simd_level() < (is_avx2 ? SimdLevel::kAvx2 : SimdLevel::kAvx512))
        continue;
      Patch same;
      kernels->prepare(image, x, y, same);
      EXPECT_NEAR(kernels->cost(same, source.quads(), h), expected, 2e-4F);
    }
  }
}

TEST(PatchKernels, CostIsZeroForEqualPatchesAndMaximalOutside) {
  const SyntheticScene& scene = relief();
  const cv::Mat1b& gray = scene.images[0].gray;
  const SourceLevel source = make_source(gray, scene.images[0].camera, {}, scene.images[0].camera);
  const GrayImage image{gray.ptr(), static_cast<std::int64_t>(gray.step[0]), gray.cols, gray.rows};
  const PatchKernels& kernels = patch_kernels();
  Patch patch;
  kernels.prepare(image, 100, 80, patch);
  const float same[9] = {100, 1, 0, 80, 0, 1, 1, 0, 0};
  EXPECT_LT(kernels.cost(patch, source.quads(), same), 0.05F);
  const float outside[9] = {-1, 1, 0, 80, 0, 1, 1, 0, 0};
  EXPECT_EQ(kernels.cost(patch, source.quads(), outside), kMaxCost);
  const float behind[9] = {100, 1, 0, 80, 0, 1, -1, 0, 0};
  EXPECT_EQ(kernels.cost(patch, source.quads(), behind), kMaxCost);
  const float through[9] = {100, 1, 0, 80, 0, 1, 1, 0.3F, 0};  // partly behind
  EXPECT_EQ(kernels.cost(patch, source.quads(), through), kMaxCost);
  const float none[9] = {NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN};
  EXPECT_EQ(kernels.cost(patch, source.quads(), none), kMaxCost);
  // Flat patches do not correlate, not even with each other.
  const cv::Mat1b flat(64, 64, static_cast<unsigned char>(90));
  const SourceLevel flat_source =
      make_source(flat, {64, 64, 60, 60, 32, 32, {}, 0}, {}, {64, 64, 60, 60, 32, 32, {}, 0});
  kernels.prepare({flat.ptr(), 64, 64, 64}, 30, 30, patch);
  const float identity_at_center[9] = {30, 1, 0, 30, 0, 1, 1, 0, 0};
  EXPECT_NEAR(kernels.cost(patch, flat_source.quads(), identity_at_center), 1, 0.01);
}

TEST(PatchKernels, InterpolatedPatchesAgreeWithThoseOfPixels) {
  const SyntheticScene& scene = relief();
  const cv::Mat1b& gray = scene.images[0].gray;
  const std::vector<std::uint32_t> words = gray_words(gray);
  const GrayQuads quads{words.data(), gray.cols, gray.rows};
  const GrayImage image{gray.ptr(), static_cast<std::int64_t>(gray.step[0]), gray.cols, gray.rows};
  for (const PatchKernels* kernels : {patch_kernels_baseline(), &patch_kernels()}) {
    for (const cv::Point& at : {cv::Point(100, 80), cv::Point(2, 1), cv::Point(238, 179)}) {
      Patch expected;
      kernels->prepare(image, at.x, at.y, expected);
      Patch patch;
      kernels->prepare_interpolated(quads, static_cast<float>(at.x), static_cast<float>(at.y), 1,
                                    patch);
      EXPECT_NEAR(patch.variance, expected.variance, 0.02F * expected.variance + 0.1F);
      for (int i = 0; i < kPatchSamples; ++i)
        EXPECT_NEAR(patch.weight[i], expected.weight[i], 2e-3F);
    }
    // A patch of half the width at a half-pixel position agrees with the image itself.
    Patch patch;
    kernels->prepare_interpolated(quads, 100.5F, 80, 0.5F, patch);
    const float same[9] = {100.5F, 0.5F, 0, 80, 0, 0.5F, 1, 0, 0};
    EXPECT_LT(kernels->cost(patch, quads, same), 0.01F);
  }
}

TEST(PlaneField, NormalsRoundTrip) {
  const geometry::Camera camera{240, 180, 200, 210, 118, 91, {}, 0};
  const cv::Vec3f normal = cv::normalize(cv::Vec3f(0.3F, -0.4F, -0.8F));
  const Plane plane = plane_of(camera, 30, 150, 0.125F, normal);
  EXPECT_LT(cv::norm(normal_of(camera, 30, 150, plane) - normal), 1e-5);
  // The same plane has the same normal at another pixel.
  Plane moved = plane;
  moved.inverse_depth += 20 * plane.slope_x - 30 * plane.slope_y;
  EXPECT_LT(cv::norm(normal_of(camera, 50, 120, moved) - normal), 1e-5);
}

TEST(PatchMatch, FindsTheDepthsOfASyntheticScene) {
  const SyntheticScene& scene = relief();
  const MatchProblem problem = scene.problem(1);
  const PlaneMap map = match_planes(problem, {});
  const std::vector<float> errors = errors_of(map.depth, scene.truth(1));
  ASSERT_GT(errors.size(), 40'000U);
  EXPECT_LT(errors[errors.size() / 2], 0.002F);
  EXPECT_LT(errors[errors.size() * 3 / 4], 0.01F);
  for (int y = 0; y < map.normal.rows; y += 7) {
    for (int x = 0; x < map.normal.cols; x += 7) {
      const cv::Vec3f& normal = map.normal(y, x);
      EXPECT_NEAR(cv::norm(normal), 1, 1e-4);
      const cv::Vec3d ray((x - problem.reference.camera.cx) / problem.reference.camera.fx,
                          (y - problem.reference.camera.cy) / problem.reference.camera.fy, 1);
      EXPECT_LT(cv::Vec3d(normal).dot(ray), 0);
    }
  }
}

TEST(PatchMatch, ThreadsDoNotChangeTheResult) {
  const MatchProblem problem = relief().problem(0);
  PatchMatchOptions options;
  options.fine_rounds = 1;
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const PlaneMap one = match_planes(problem, options);
  cv::setNumThreads(3);
  const PlaneMap three = match_planes(problem, options);
  cv::setNumThreads(threads);
  EXPECT_EQ(cv::norm(one.depth, three.depth, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(one.normal, three.normal, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(one.cost, three.cost, cv::NORM_INF), 0);
}

TEST(PatchMatch, ConsistentDepthsAreCorrect) {
  const SyntheticScene& scene = relief();
  MatchProblem problem = scene.problem(1);
  for (std::size_t s = 0; s < problem.sources.size(); ++s) {
    const std::size_t index = s < 1 ? s : s + 1;
    problem.sources[s].depth = match_planes(scene.problem(index), {}).depth;
  }
  const PlaneMap map = refine_planes(problem, match_planes(problem, {}), {});
  const DepthMap filtered_map = filtered(problem, map, {});
  const std::vector<float> errors = errors_of(filtered_map.depth, scene.truth(1));
  EXPECT_GT(errors.size(), map.depth.total() * 6 / 10);
  EXPECT_LT(errors[errors.size() / 2], 0.001F);
  EXPECT_LT(errors[errors.size() * 9 / 10], 0.01F);
  EXPECT_EQ(cv::countNonZero(filtered_map.confidence > 0), static_cast<int>(errors.size()));
}

// A wall of upright bars, every second bar farther away, seen from the left, the middle and the
// right.
class Bars {
 public:
  static constexpr double kNear = 10;
  static constexpr double kFar = 10.12;
  static constexpr double kWidth = 0.45;
  static bool is_near(double x) { return std::fmod(x + 100 * kWidth, 2 * kWidth) < kWidth; }

  [[nodiscard]] MatchImage image(double left) const {
    MatchImage result;
    result.camera = {240, 180, 220, 220, 119.5, 89.5, {}, 0};
    result.pose.translation = {-left, 0, 0};
    result.large.create(180, 240);
    for (int y = 0; y < 180; ++y)
      for (int x = 0; x < 240; ++x)
        result.large(y, x) = cv::saturate_cast<std::uint8_t>(gray(result.camera, left, x, y));
    cv::resize(result.large, result.gray, {120, 90}, 0, 0, cv::INTER_AREA);
    result.camera = {120, 90, 110, 110, 59.5, 44.5, {}, 0};
    return result;
  }
  // The share of the middle image's depths with an error below 0.3 %.
  static double share_right(const cv::Mat1f& depth) {
    int right = 0;
    int all = 0;
    for (int y = 10; y < 80; ++y) {
      for (int x = 20; x < 100; ++x) {
        const double across = (x - 59.5) / 110;
        const double expected = is_near(across * kNear) ? kNear : kFar;
        ++all;
        if (std::abs(static_cast<double>(depth(y, x)) / expected - 1) < 0.003) ++right;
      }
    }
    return static_cast<double>(right) / all;
  }

 private:
  static double gray(const geometry::Camera& camera, double left, int u, int v) {
    const double across = (u - camera.cx) / camera.fx;
    const double x = across * kNear + left;
    const double z = is_near(x) ? kNear : kFar;
    const double px = z * 30 * (across + left / z);
    const double py = z * 30 * (v - camera.cy) / camera.fy;
    return 128 + 45 * std::sin(0.41 * px + 1.7 * std::sin(0.23 * py)) +
           40 * std::sin(0.37 * py + 1.9 * std::sin(0.19 * px)) +
           25 * std::sin(0.5 * px - 0.31 * py);
  }
};

TEST(PatchMatch, LargerImagesShowReliefNarrowerThanAPatch) {
  const Bars bars;
  MatchProblem problem;
  problem.reference = bars.image(0);
  for (const double left : {-2.0, -1.2, 1.2, 2.0}) problem.sources.push_back(bars.image(left));
  problem.min_depth = 8;
  problem.max_depth = 12;
  const double with = Bars::share_right(match_planes(problem, {}).depth);
  problem.reference.large = {};
  for (MatchImage& source : problem.sources) source.large = {};
  const double without = Bars::share_right(match_planes(problem, {}).depth);
  EXPECT_GT(with, without + 0.3);
  EXPECT_GT(with, 0.5);
}

TEST(PatchMatch, KnownPointsImproveTheInitialisation) {
  const SyntheticScene& scene = relief();
  MatchProblem problem = scene.problem(2);
  const cv::Mat1f truth = scene.truth(2);
  for (int y = 5; y < truth.rows; y += 20)
    for (int x = 5; x < truth.cols; x += 20)
      problem.known.push_back({cv::Point2d(x, y), truth(y, x)});
  problem.known.push_back({cv::Point2d(-50, 1e9), 10});  // outside
  problem.known.push_back({cv::Point2d(5, 5), 1e6});     // out of the range
  PatchMatchOptions quick;
  quick.coarse_rounds = 1;
  quick.middle_rounds = 1;
  quick.fine_rounds = 0;
  const std::vector<float> with = errors_of(match_planes(problem, quick).depth, truth);
  problem.known.clear();
  const std::vector<float> without = errors_of(match_planes(problem, quick).depth, truth);
  EXPECT_LT(with[with.size() * 8 / 10], without[without.size() * 8 / 10]);
}

TEST(PatchMatch, RefusesInvalidProblems) {
  MatchProblem problem = relief().problem(0);
  problem.min_depth = 0;
  EXPECT_THROW((void)match_planes(problem, {}), std::invalid_argument);
  problem = relief().problem(0);
  problem.sources.clear();
  EXPECT_THROW((void)match_planes(problem, {}), std::invalid_argument);
  problem = relief().problem(0);
  problem.sources[0].camera.width = 100;
  EXPECT_THROW((void)match_planes(problem, {}), std::invalid_argument);
  problem = relief().problem(0);
  problem.sources[0].large = cv::Mat1b(8, 8);
  EXPECT_THROW((void)match_planes(problem, {}), std::invalid_argument);
  problem = relief().problem(0);
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW((void)match_planes(problem, {}, stop.get_token()), Interrupted);
}

TEST(DepthFilter, RemovesSmallSegments) {
  DepthMap map;
  map.depth = cv::Mat1f(20, 20, 0.F);
  map.normal = cv::Mat3f(20, 20, cv::Vec3f(0, 0, -1));
  map.confidence = cv::Mat1f(20, 20, 1.F);
  map.depth(cv::Rect(1, 1, 2, 2)).setTo(5);
  map.depth(cv::Rect(8, 8, 5, 5)).setTo(5);
  map.depth(cv::Rect(13, 8, 2, 2)).setTo(6);  // a neighbour that is farther away
  remove_small_segments(map, 5, 0.01);
  EXPECT_EQ(cv::countNonZero(map.depth), 25);
  EXPECT_EQ(map.confidence.at<float>(1, 1), 0);
  EXPECT_EQ(map.normal.at<cv::Vec3f>(9, 14), cv::Vec3f(0, 0, 0));
}

}  // namespace
}  // namespace tarsier::sfm
