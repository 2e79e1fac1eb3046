// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper.h"

#include "tarsier/core/rng.h"
#include "tarsier/sfm/bundle.h"
#include "tarsier/sfm_io/align.h"
#include "tarsier/synth/relief.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <set>

namespace tarsier::sfm {
namespace {

using testing::HasSubstr;

// A point problem as the mapper takes it: features, and matches by the points' identity.
struct Problem {
  synth::PointProblem truth;
  std::vector<geometry::Camera> cameras;
  std::vector<Photograph> images;
  std::vector<std::vector<cv::Vec3b>> colors;
  std::vector<Pair> pairs;
  std::vector<std::vector<int>> point_of;  // of each feature
};

Problem problem_of(const synth::PointProblem& truth) {
  Problem problem;
  problem.truth = truth;
  problem.cameras = {truth.camera};
  problem.images.resize(truth.poses.size());
  problem.point_of.resize(truth.poses.size());
  for (std::size_t i = 0; i < truth.poses.size(); ++i)
    problem.images[i].name = "photo-" + std::to_string(i);
  for (const auto& seen : truth.seen) {
    const auto i = static_cast<std::size_t>(seen.image);
    problem.images[i].features.emplace_back(seen.pixel);
    problem.point_of[i].push_back(seen.point);
  }
  for (const Photograph& image : problem.images)
    problem.colors.emplace_back(image.features.size(), cv::Vec3b(10, 20, 30));
  for (std::size_t a = 0; a < problem.images.size(); ++a) {
    for (std::size_t b = a + 1; b < problem.images.size(); ++b) {
      std::map<int, int> in_b;
      for (std::size_t f = 0; f < problem.point_of[b].size(); ++f)
        in_b[problem.point_of[b][f]] = static_cast<int>(f);
      std::vector<Match> matches;
      for (std::size_t f = 0; f < problem.point_of[a].size(); ++f) {
        const auto other = in_b.find(problem.point_of[a][f]);
        if (other != in_b.end()) matches.push_back({static_cast<int>(f), other->second});
      }
      Pair pair;
      pair.first = static_cast<int>(a);
      pair.second = static_cast<int>(b);
      pair.matches = static_cast<int>(matches.size());
      pair.view = verify_pair(problem.images[a].features, problem.images[b].features, matches,
                              truth.camera, truth.camera, {});
      problem.pairs.push_back(std::move(pair));
    }
  }
  return problem;
}

Reconstruction run(const Problem& problem, const MapperOptions& options = {}) {
  NoProgress progress;
  return reconstruct(problem.cameras, problem.images, problem.colors, {}, FeatureKind::kSift,
                     problem.pairs, options, progress, {});
}

// Largest distance of a centre from the truth after the best similarity, by the truth's extent.
double worst_center(const Model& model, const synth::PointProblem& truth) {
  std::vector<cv::Vec3d> from;
  std::vector<cv::Vec3d> to;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    if (!model.images[i].registered) continue;
    from.push_back(model.images[i].pose.center());
    to.push_back(truth.poses[i].center());
  }
  const auto similarity = similarity_between(from, to);
  if (!similarity) return 1e9;
  double worst = 0;
  double extent = 0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    worst = std::max(worst, cv::norm(similarity->scale * (similarity->rotation * from[i]) +
                                     similarity->translation - to[i]));
    extent = std::max(extent, cv::norm(to[i] - to[0]));
  }
  return worst / extent;
}

TEST(Reconstruct, WithoutNoiseItIsExact) {
  const Problem problem = problem_of(synth::make_point_problem(1, 7, 300, 0, 0));
  const Reconstruction built = run(problem);
  ASSERT_EQ(built.models.size(), 1U);
  const ModelStatistics statistics = statistics_of(built.models[0]);
  EXPECT_EQ(statistics.registered, 7);
  EXPECT_LT(statistics.reprojection_px, 1e-3);  // features are single precision
  EXPECT_LT(worst_center(built.models[0], problem.truth), 1e-4);
  EXPECT_GT(built.models[0].points.size(), 250U);
  EXPECT_EQ(built.models[0].points[0].color, cv::Vec3b(10, 20, 30));
}

TEST(Reconstruct, NoiseAndOutliersAreHeldOff) {
  const Problem problem = problem_of(synth::make_point_problem(2, 8, 500, 0.5, 0.15));
  const Reconstruction built = run(problem);
  ASSERT_EQ(built.models.size(), 1U);
  EXPECT_EQ(statistics_of(built.models[0]).registered, 8);
  EXPECT_LT(worst_center(built.models[0], problem.truth), 0.005);
  EXPECT_LT(statistics_of(built.models[0]).reprojection_px, 0.8);
}

TEST(Reconstruct, IndicesOfTheModelFitTogether) {
  const Problem problem = problem_of(synth::make_point_problem(3, 6, 200, 0.3, 0.05));
  const Reconstruction built = run(problem);
  ASSERT_EQ(built.models.size(), 1U);
  const Model& model = built.models[0];
  for (std::size_t p = 0; p < model.points.size(); ++p) {
    ASSERT_GE(model.points[p].track.size(), 3U);
    for (const Observation& seen : model.points[p].track)
      EXPECT_EQ(model.images[static_cast<std::size_t>(seen.image)]
                    .points[static_cast<std::size_t>(seen.feature)],
                static_cast<int>(p));
  }
}

TEST(Reconstruct, TwoScenesGiveTwoModels) {
  Problem problem = problem_of(synth::make_point_problem(4, 5, 200, 0.2, 0));
  const Problem other = problem_of(synth::make_point_problem(5, 4, 200, 0.2, 0));
  for (const Photograph& image : other.images) problem.images.push_back(image);
  for (const auto& colors : other.colors) problem.colors.push_back(colors);
  for (Pair pair : other.pairs) {
    pair.first += 5;
    pair.second += 5;
    problem.pairs.push_back(pair);
  }
  const Reconstruction built = run(problem);
  ASSERT_EQ(built.models.size(), 2U);
  EXPECT_EQ(statistics_of(built.models[0]).registered, 5);
  EXPECT_EQ(statistics_of(built.models[1]).registered, 4);
  for (int i = 0; i < 9; ++i) {
    EXPECT_TRUE(built.outcomes[static_cast<std::size_t>(i)].registered);
    EXPECT_EQ(built.outcomes[static_cast<std::size_t>(i)].model, i < 5 ? 0 : 1);
  }
}

TEST(Reconstruct, APhotographThatMatchesNothingIsMissingWithItsReason) {
  Problem problem = problem_of(synth::make_point_problem(6, 5, 200, 0.2, 0));
  Photograph stranger;
  stranger.name = "stranger";
  stranger.features = problem.images[0].features;
  problem.images.push_back(stranger);
  problem.colors.push_back(problem.colors[0]);
  Pair pair;
  pair.first = 2;
  pair.second = 5;
  pair.matches = 7;
  problem.pairs.push_back(pair);
  const Reconstruction built = run(problem);
  ASSERT_EQ(built.models.size(), 1U);
  EXPECT_FALSE(built.outcomes[5].registered);
  EXPECT_THAT(built.outcomes[5].reason, HasSubstr("at most 7, with photo-2"));
}

TEST(Reconstruct, ACameraThatOnlyTurnsGivesNoModelButAReason) {
  synth::PointProblem truth = synth::make_point_problem(7, 3, 300, 0, 0);
  truth.seen.clear();
  // All cameras at the place of the first.
  const cv::Vec3d center = truth.poses[0].center();
  for (int i = 0; i < 3; ++i) {
    auto& pose = truth.poses[static_cast<std::size_t>(i)];
    pose.rotation = truth.poses[0].rotation;
    const double turn = 0.03 * i;
    pose.rotation = cv::Matx33d(std::cos(turn), 0, std::sin(turn), 0, 1, 0, -std::sin(turn), 0,
                                std::cos(turn)) *
                    pose.rotation;
    pose.translation = -(pose.rotation * center);
    for (std::size_t p = 0; p < truth.points.size(); ++p) {
      const auto pixel = truth.camera.project(pose * truth.points[p]);
      if (pixel && pixel->x >= 0 && pixel->y >= 0 && pixel->x < 639 && pixel->y < 479)
        truth.seen.push_back({i, static_cast<int>(p), *pixel, false});
    }
  }
  const Reconstruction built = run(problem_of(truth));
  EXPECT_TRUE(built.models.empty());
  EXPECT_THAT(built.no_model, HasSubstr("sideways"));
}

TEST(Reconstruct, AWrongFocalLengthIsRefined) {
  const Problem exact = problem_of(synth::make_point_problem(8, 9, 500, 0.2, 0));
  Problem problem = exact;
  problem.cameras[0].fx *= 1.12;
  problem.cameras[0].fy *= 1.12;
  MapperOptions options;
  options.refine_focal = true;
  const Reconstruction built = run(problem, options);
  ASSERT_FALSE(built.models.empty());
  EXPECT_NEAR(built.models[0].cameras[0].fx / exact.cameras[0].fx, 1, 0.02);
}

TEST(Adjust, MovesAwayFromTheTruthComeBack) {
  const Problem problem = problem_of(synth::make_point_problem(9, 6, 150, 0, 0));
  Model model = run(problem).models.at(0);
  const Model before = model;
  Rng rng(1);
  for (std::size_t i = 2; i < model.images.size(); ++i)
    for (int k = 0; k < 3; ++k) model.images[i].pose.translation[k] += rng.normal(0, 0.02);
  for (Point& point : model.points)
    for (int k = 0; k < 3; ++k) point.position[k] += rng.normal(0, 0.02);
  const BundleReport report = adjust(model, {});
  EXPECT_GT(report.before_px, 1);
  EXPECT_LT(report.after_px, 1e-2);
  EXPECT_LT(worst_center(model, problem.truth), 1e-3);
}

TEST(Adjust, DoesNotDependOnWhereTheHeapPutsThings) {
  const Problem problem = problem_of(synth::make_point_problem(9, 6, 150, 0.3, 0));
  const Model start = run(problem).models.at(0);
  BundleOptions options;
  options.focal = true;
  std::set<double> focal_lengths;
  for (std::size_t hole = 0; hole < 12; ++hole) {
    // Free memory of several sizes below what comes after it: some arrays get it, others do not.
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

TEST(FilterPoints, TakesOutWhatIsOff) {
  const Problem problem = problem_of(synth::make_point_problem(10, 5, 100, 0, 0));
  Model model = run(problem).models.at(0);
  const std::size_t seen = model.points[3].track.size();
  model.images[static_cast<std::size_t>(model.points[3].track[0].image)]
      .features[static_cast<std::size_t>(model.points[3].track[0].feature)] += cv::Point2f(9, 0);
  EXPECT_GE(filter_points(model, {}), 1);
  EXPECT_LT(model.points[3].track.size(), seen);
}

TEST(MapperOptions, ImpossibleOnesAreRefused) {
  MapperOptions options;
  options.pose_inliers = 2;
  EXPECT_THROW(options.check(), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
