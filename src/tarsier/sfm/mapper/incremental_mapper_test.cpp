// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/incremental_mapper.h"

#include "tarsier/core/rng.h"
#include "tarsier/sfm/bundle/bundle.h"
#include "tarsier/sfm/mapper/mapping.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/mapper/testing_centers.h"
#include "tarsier/sfm/mapper/testing_point_problem.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

using test_support::described;
using test_support::DescribedProblem;
using test_support::Problem;
using test_support::problem_of;

using testing::HasSubstr;

Reconstruction run(const Problem& problem) {
  NoProgress progress;
  const std::vector<cv::Mat> no_descriptors;
  return map_images(input_of(problem, no_descriptors), {}, progress, {}, {}).reconstruction;
}

// The incremental counters equal a count over all features.
TEST(IncrementalMapper, CountsVisiblePointsOfEachImage) {
  const DescribedProblem given = described(synth::make_point_problem(23, 8, 200, 0.4, 0.1));
  const Problem& problem = given.problem;
  Model model;
  model.cameras = problem.cameras;
  model.images = problem.images;
  std::vector<int> features;
  for (const Image& image : problem.images)
    features.push_back(static_cast<int>(image.features.size()));
  const MapperOptions options;
  IncrementalMapper mapper(model, make_tracks(problem.pairs, features), given.descriptors,
                           FeatureKind::kSift, options);
  const auto check = [&](const char* when) {
    for (int i = 0; i < 8; ++i) {
      const auto seen = mapper.visible(i);
      EXPECT_EQ(static_cast<std::size_t>(mapper.visible_count(i)), seen.size()) << when << " " << i;
      double next_best_view_score = 0;
      for (int cells = 2; cells <= 32; cells *= 2) {
        std::set<std::pair<int, int>> occupied;
        for (const auto& [feature, track] : seen) {
          const cv::Point2f& p = problem.images[static_cast<std::size_t>(i)]
                                     .features[static_cast<std::size_t>(feature)];
          const auto cell = [&](float x, int size) {
            return std::clamp(static_cast<int>(static_cast<double>(x) * cells / size), 0,
                              cells - 1);
          };
          occupied.insert(
              {cell(p.x, problem.cameras[0].width), cell(p.y, problem.cameras[0].height)});
        }
        next_best_view_score += static_cast<double>(occupied.size()) * cells;
      }
      EXPECT_EQ(mapper.next_best_view_score(i), next_best_view_score) << when << " " << i;
    }
  };
  check("empty");
  std::string why;
  ASSERT_TRUE(mapper.start(problem.pairs[3], {}, why)) << why;
  check("start");
  for (int i = 0; i < 8; ++i) {
    if (mapper.model().images[static_cast<std::size_t>(i)].registered) continue;
    EXPECT_TRUE(mapper.add(i, {}, why)) << why;
    check("add");
  }
  mapper.refine_all(2, {.tolerance = 1e-4}, {});
  check("refine");
  EXPECT_GT(mapper.extend_tracks({}), 0);
  check("extend");
  mapper.refine_all(1, {.tolerance = 1e-4}, {});
  check("the end");
}

// If only few points or observations are adjusted, the other points move with them.
TEST(IncrementalMapper, AdjustsUnselectedPointsAfterwards) {
  const Problem problem = problem_of(synth::make_point_problem(23, 8, 400, 0.4, 0));
  Model model;
  model.cameras = problem.cameras;
  model.cameras[0].fx *= 1.03;
  model.cameras[0].fy *= 1.03;
  model.images = problem.images;
  std::vector<int> features;
  for (const Image& image : problem.images)
    features.push_back(static_cast<int>(image.features.size()));
  MapperOptions options;
  options.refine_focal = true;
  options.reprojection_px = 8;
  const std::vector<cv::Mat> descriptors;
  const auto error_by = [&](int points_per_image, int max_observations) {
    IncrementalMapper mapper(model, make_tracks(problem.pairs, features), descriptors,
                             FeatureKind::kSift, options);
    std::string why;
    EXPECT_TRUE(mapper.start(problem.pairs[3], {}, why)) << why;
    for (int i = 0; i < 8; ++i) {
      if (mapper.model().images[static_cast<std::size_t>(i)].registered) continue;
      EXPECT_TRUE(mapper.add(i, {}, why)) << why;
    }
    mapper.refine_once({.tolerance = 1e-6,
                        .points_per_image = points_per_image,
                        .max_observations = max_observations},
                       {});
    return statistics_of(mapper.model()).reprojection_px;
  };
  const double error = error_by(0, 0);
  EXPECT_LT(error_by(60, 0), 1.1 * error);
  EXPECT_LT(error_by(100, 4), 1.3 * error);
}

TEST(Adjust, RecoversPerturbedModel) {
  const Problem problem = problem_of(synth::make_point_problem(9, 6, 150, 0, 0));
  Model model = run(problem).models.at(0);
  const Model before = model;
  Rng rng(1);
  for (std::size_t i = 2; i < model.images.size(); ++i)
    for (int k = 0; k < 3; ++k) model.images[i].pose.translation[k] += rng.normal(0, 0.02);
  for (Point& point : model.points)
    for (int k = 0; k < 3; ++k) point.position[k] += rng.normal(0, 0.02);
  ASSERT_GT(worst_center(model, problem.truth.poses), 3e-3);
  EXPECT_TRUE(adjust(model, {}).warning.empty());
  EXPECT_LT(worst_center(model, problem.truth.poses), 1e-3);
  for (const Point& point : model.points)
    for (const Observation& seen : point.track)
      EXPECT_LT(IncrementalMapper::reprojection_error(model, seen, point.position).value_or(1),
                1e-2);
}

TEST(Adjust, PartialAdjustmentFindsItsPoints) {
  const Problem problem = problem_of(synth::make_point_problem(9, 9, 150, 0.3, 0));
  Model start = run(problem).models.at(0);
  // Points that neither of the two observes.
  for (std::size_t p = 0; p < start.points.size(); p += 3)
    std::erase_if(start.points[p].track,
                  [](const Observation& seen) { return seen.image == 2 || seen.image == 4; });
  BundleOptions options;
  options.images = {4, 2};
  Model found = start;
  const BundleReport report = adjust(found, options);
  EXPECT_TRUE(report.warning.empty());
  for (std::size_t p = 0; p < start.points.size(); ++p) {
    for (const Observation& seen : start.points[p].track) {
      if (seen.image != 2 && seen.image != 4) continue;
      options.points.push_back(static_cast<int>(p));
      break;
    }
  }
  ASSERT_LT(options.points.size(), start.points.size());
  Model given = start;
  adjust(given, options);
  for (std::size_t i = 0; i < start.images.size(); ++i) {
    EXPECT_EQ(found.images[i].pose.translation, given.images[i].pose.translation);
    EXPECT_EQ(start.images[i].pose.translation != given.images[i].pose.translation,
              i == 2 || i == 4);
  }
}

TEST(Adjust, OnlyPointsMovesPointsAlone) {
  const Problem problem = problem_of(synth::make_point_problem(9, 6, 150, 0, 0));
  const Model before = run(problem).models.at(0);
  Model model = before;
  Rng rng(1);
  BundleOptions options;
  options.only_points = true;
  options.focal = true;  // has no effect here
  for (std::size_t p = 0; p < model.points.size(); ++p) {
    for (int k = 0; k < 3; ++k) model.points[p].position[k] += rng.normal(0, 0.02);
    if (p % 2 == 0) options.points.push_back(static_cast<int>(p));
  }
  const Model moved = model;
  EXPECT_TRUE(adjust(model, options).warning.empty());
  EXPECT_EQ(model.cameras[0].fx, before.cameras[0].fx);
  for (std::size_t i = 0; i < model.images.size(); ++i)
    EXPECT_EQ(model.images[i].pose.translation, before.images[i].pose.translation) << i;
  for (std::size_t p = 0; p < model.points.size(); ++p) {
    if (p % 2 == 0) {
      EXPECT_LT((model.points[p].position - before.points[p].position).norm(), 1e-3) << p;
    } else {
      EXPECT_EQ(model.points[p].position, moved.points[p].position) << p;
    }
  }
}

TEST(Adjust, RejectsFocalLengthOutOfRangeWithWarning) {
  const Problem problem = problem_of(synth::make_point_problem(9, 6, 150, 0.1, 0));
  Model model = run(problem).models.at(0);
  // The image is so wide that the true focal length is just below the allowed min share of the
  // width.
  const double truth = model.cameras[0].fx;
  model.cameras[0].width = static_cast<int>(truth / (0.99 * kMinFocalShare));
  const double start = 1.04 * truth;
  model.cameras[0].fx = model.cameras[0].fy = start;
  BundleOptions options;
  options.focal = true;
  const BundleReport report = adjust(model, options);
  EXPECT_NEAR(model.cameras[0].fx, start, 1e-9 * start);
  EXPECT_THAT(report.warning, HasSubstr("focal length"));
  EXPECT_GT(report.iterations, 0);  // the rest is adjusted
  // With a wider range, the right focal length is found.
  model.cameras[0].width = 640;
  EXPECT_TRUE(adjust(model, options).warning.empty());
  EXPECT_NEAR(model.cameras[0].fx, truth, 0.02 * truth);
}

TEST(Adjust, UnsolvableModelGivesWarningAndIsUnchanged) {
  const Problem problem = problem_of(synth::make_point_problem(9, 6, 150, 0.1, 0));
  Model model = run(problem).models.at(0);
  model.points[0].position =
      model.images[0].pose.inverse() * Eigen::Vector3d(0, 0, -5);  // behind it
  const Model before = model;
  const BundleReport report = adjust(model, {});
  EXPECT_FALSE(report.warning.empty());
  for (std::size_t i = 0; i < model.images.size(); ++i)
    EXPECT_EQ(model.images[i].pose.translation, before.images[i].pose.translation);
  for (std::size_t p = 0; p < model.points.size(); ++p)
    EXPECT_EQ(model.points[p].position, before.points[p].position);
}

TEST(Adjust, ResultDoesNotDependOnMemoryLayout) {
  const Problem problem = problem_of(synth::make_point_problem(9, 6, 150, 0.3, 0));
  const Model start = run(problem).models.at(0);
  BundleOptions options;
  options.focal = true;
  std::set<double> focal_lengths;
  for (std::size_t hole = 0; hole < 12; ++hole) {
    // Leaves free memory blocks of several sizes: some of the later arrays use them, others do not.
    std::vector<std::vector<char>> blocks;
    for (std::size_t size = 16; size <= 1024; size += 8) blocks.emplace_back(size);
    const std::vector<char> above(1 << 16);
    for (std::size_t k = hole; k < blocks.size(); k += hole + 1)
      std::vector<char>().swap(blocks[k]);
    Model model = start;
    adjust(model, options);
    focal_lengths.insert(model.cameras.at(0).fx);
  }
  EXPECT_EQ(focal_lengths.size(), 1U);
}

TEST(FilterPoints, RemovesOutliers) {
  const Problem problem = problem_of(synth::make_point_problem(10, 5, 100, 0, 0));
  Model model = run(problem).models.at(0);
  const std::size_t seen = model.points[3].track.size();
  model.images[static_cast<std::size_t>(model.points[3].track[0].image)]
      .features[static_cast<std::size_t>(model.points[3].track[0].feature)] += cv::Point2f(9, 0);
  EXPECT_GE(filter_points(model, {}), 1);
  EXPECT_LT(model.points[3].track.size(), seen);
}

TEST(FilterPoints, RemovesOutliersOfGivenPointsAndImagesOnly) {
  const Problem problem = problem_of(synth::make_point_problem(10, 5, 100, 0, 0));
  Model model = run(problem).models.at(0);
  ASSERT_GE(model.points[3].track.size(), 4U);
  const std::vector<Observation> before = model.points[3].track;
  for (const std::size_t k : {0U, 1U})
    model.images[static_cast<std::size_t>(before[k].image)]
        .features[static_cast<std::size_t>(before[k].feature)] += cv::Point2f(9, 0);
  EXPECT_EQ(filter_selected_points(model, {}, {3}, {before[1].image, before[2].image}), 1);
  ASSERT_EQ(model.points[3].track.size(), before.size() - 1);
  EXPECT_EQ(model.points[3].track[0].image, before[0].image);
  EXPECT_EQ(model.points[3].track[1].image, before[2].image);
}

TEST(MapperOptions, RefusesInvalidValues) {
  MapperOptions options;
  options.pose_inliers = 2;
  EXPECT_THROW(options.check(), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
