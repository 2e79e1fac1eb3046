// SPDX-License-Identifier: MIT
#include "tarsier/sfm/reconstruction/reconstruct.h"

#include "tarsier/core/errors.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/mapper/testing_centers.h"
#include "tarsier/sfm/mapper/testing_point_problem.h"
#include "tarsier/sfm/mapper/testing_reconstruction.h"
#include "tarsier/synth/sfm_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

using test_support::described;
using test_support::DescribedProblem;
using test_support::expect_same;
using test_support::Problem;
using test_support::problem_of;

using testing::HasSubstr;

Reconstruction run(const Problem& problem, const MapperOptions& options = {}) {
  NoProgress progress;
  const std::vector<cv::Mat> no_descriptors;
  return reconstruct(input_of(problem, no_descriptors), options, progress, {});
}

Reconstruction run(const DescribedProblem& given, const MapperHooks& hooks,
                   const std::stop_token& stop = {}) {
  NoProgress progress;
  return reconstruct(input_of(given.problem, given.descriptors), {}, progress, stop, hooks);
}

// Two independent scenes with these numbers of images.
Problem two_scenes(int first, int second) {
  Problem problem = problem_of(synth::make_point_problem(4, first, 200, 0.2, 0));
  const Problem other = problem_of(synth::make_point_problem(5, second, 200, 0.2, 0));
  for (const Image& image : other.images) problem.images.push_back(image);
  for (const auto& colors : other.colors) problem.colors.push_back(colors);
  for (Pair pair : other.pairs) {
    pair.first += first;
    pair.second += first;
    problem.pairs.push_back(pair);
  }
  return problem;
}

TEST(Reconstruct, IsExactWithoutNoise) {
  const Problem problem = problem_of(synth::make_point_problem(1, 7, 300, 0, 0));
  const Reconstruction built = run(problem);
  ASSERT_EQ(built.models.size(), 1U);
  const ModelStatistics statistics = statistics_of(built.models[0]);
  EXPECT_EQ(statistics.registered, 7);
  EXPECT_LT(statistics.reprojection_px, 1e-3);  // features have single precision
  EXPECT_LT(worst_center(built.models[0], problem.truth.poses), 1e-4);
  EXPECT_GT(built.models[0].points.size(), 250U);
  EXPECT_EQ(built.models[0].points[0].color, cv::Vec3b(10, 20, 30));
}

TEST(Reconstruct, ToleratesNoiseAndOutliers) {
  const Problem problem = problem_of(synth::make_point_problem(2, 8, 500, 0.5, 0.15));
  const Reconstruction built = run(problem);
  ASSERT_EQ(built.models.size(), 1U);
  EXPECT_EQ(statistics_of(built.models[0]).registered, 8);
  EXPECT_LT(worst_center(built.models[0], problem.truth.poses), 0.005);
  EXPECT_LT(statistics_of(built.models[0]).reprojection_px, 0.8);
}

TEST(Reconstruct, ModelIndicesAreConsistent) {
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
  const Problem problem = two_scenes(5, 4);
  const Reconstruction built = run(problem);
  ASSERT_EQ(built.models.size(), 2U);
  EXPECT_EQ(statistics_of(built.models[0]).registered, 5);
  EXPECT_EQ(statistics_of(built.models[1]).registered, 4);
  for (int i = 0; i < 9; ++i) {
    EXPECT_TRUE(built.outcomes[static_cast<std::size_t>(i)].registered);
    EXPECT_EQ(built.outcomes[static_cast<std::size_t>(i)].model, i < 5 ? 0 : 1);
    // A model does not keep the features of images that are not in it.
    for (std::size_t m = 0; m < 2; ++m) {
      const Image& image = built.models[m].images[static_cast<std::size_t>(i)];
      EXPECT_EQ(image.features.empty(), !image.registered);
      EXPECT_EQ(image.name, problem.images[static_cast<std::size_t>(i)].name);
    }
  }
}

TEST(Checkpoints, ResumingFromAnyGivesSameResult) {
  const DescribedProblem given = described(synth::make_point_problem(21, 9, 160, 0.4, 0.15));
  std::vector<MapperState> states;
  MapperHooks hooks;
  hooks.save_interval_s = 0;
  hooks.save_checkpoint = [&](const MapperState& state) { states.push_back(state); };
  const Reconstruction whole = run(given, hooks);
  ASSERT_EQ(statistics_of(whole.models.at(0)).registered, 9);
  ASSERT_GT(states.size(), 9U);
  EXPECT_TRUE(states.back().done);
  bool extended = false;
  for (std::size_t k = 0; k < states.size(); ++k) {
    extended = extended || (states[k].current && !states[k].current->tracks.empty());
    MapperHooks from;
    from.resume_from = states[k];
    const Reconstruction again = run(given, from);
    EXPECT_EQ(again.resumed, states[k].registered()) << k;
    expect_same(again, whole);
  }
  EXPECT_TRUE(extended);
}

TEST(Checkpoints, ResumeAfterFinishedModel) {
  const DescribedProblem given{two_scenes(5, 4), {}};
  std::vector<MapperState> states;
  MapperHooks hooks;
  hooks.save_interval_s = 0;
  hooks.save_checkpoint = [&](const MapperState& state) { states.push_back(state); };
  const Reconstruction whole = run(given, hooks);
  ASSERT_EQ(whole.models.size(), 2U);
  bool second = false;
  for (const MapperState& state : states) {
    second = second || (state.models.size() == 1 && state.current);
    MapperHooks from;
    from.resume_from = state;
    expect_same(run(given, from), whole);
  }
  EXPECT_TRUE(second);
}

TEST(Checkpoints, IgnoreThoseOfOtherImages) {
  const DescribedProblem given = described(synth::make_point_problem(21, 6, 160, 0.4, 0.05));
  const DescribedProblem other = described(synth::make_point_problem(22, 5, 100, 0.4, 0.05));
  MapperHooks hooks;
  hooks.save_checkpoint = [&](const MapperState& state) { hooks.resume_from = state; };
  const Reconstruction whole = run(given, hooks);
  ASSERT_TRUE(hooks.resume_from);
  EXPECT_EQ(run(other, hooks).resumed, 0);
}

// Stopped within each adjustment: the finished models are returned, and the checkpoint of that
// moment leads to the same result.
TEST(Interrupted, ReturnsPartialModelAndCheckpoint) {
  const DescribedProblem given = described(synth::make_point_problem(21, 9, 160, 0.4, 0.15));
  const Reconstruction whole = run(given, {});
  int adjustments = 0;
  {
    MapperHooks hooks;
    hooks.watch = [&](const std::string& label, const Model&) {
      adjustments += label.ends_with("before") ? 1 : 0;
    };
    (void)run(given, hooks);
  }
  ASSERT_GT(adjustments, 9);
  int partial = 0;
  for (int last = 1; last <= adjustments; ++last) {
    std::stop_source stop;
    std::optional<MapperState> kept;
    int count = 0;
    MapperHooks hooks;
    hooks.partial = true;
    hooks.save_interval_s = 1e6;
    hooks.save_checkpoint = [&](const MapperState& state) { kept = state; };
    hooks.watch = [&](const std::string& label, const Model&) {
      if (label.ends_with("before") && ++count == last) stop.request_stop();
    };
    try {
      const Reconstruction so_far = run(given, hooks, stop.get_token());
      EXPECT_TRUE(so_far.interrupted);
      ASSERT_EQ(so_far.models.size(), 1U);
      EXPECT_GE(statistics_of(so_far.models[0]).registered, 2);
      EXPECT_LT(statistics_of(so_far.models[0]).reprojection_px, 2);
      ++partial;
    } catch (const tarsier::Interrupted&) {
      EXPECT_EQ(last, 1);  // stopped within the first pair: there is no model yet
    }
    ASSERT_TRUE(kept);
    MapperHooks from;
    from.resume_from = kept;
    expect_same(run(given, from), whole);
  }
  EXPECT_EQ(partial, adjustments - 1);
}

// The caller is shown a growing number of images, and the result is the same.
TEST(Mapper, ShowsGrowingModel) {
  const DescribedProblem given = described(synth::make_point_problem(21, 9, 160, 0.4, 0.15));
  std::vector<int> registered;
  MapperHooks hooks;
  hooks.show_interval_s = 0;
  hooks.show = [&](const Model& model) {
    const ModelStatistics size = statistics_of(model);
    EXPECT_GT(size.observations, 0);
    registered.push_back(size.registered);
  };
  const Reconstruction shown = run(given, hooks);
  expect_same(shown, run(given, {}));
  ASSERT_FALSE(registered.empty());
  EXPECT_TRUE(std::is_sorted(registered.begin(), registered.end()));
  EXPECT_LE(registered.back(), statistics_of(shown.models[0]).registered);
}

TEST(Interrupted, WithoutPartialThrows) {
  const DescribedProblem given = described(synth::make_point_problem(21, 6, 160, 0.4, 0.05));
  std::stop_source stop;
  MapperHooks hooks;
  hooks.watch = [&](const std::string& label, const Model&) {
    if (label == "grown-004-after") stop.request_stop();
  };
  EXPECT_THROW((void)run(given, hooks, stop.get_token()), tarsier::Interrupted);
}

TEST(Reconstruct, GivesReasonForUnmatchedImage) {
  Problem problem = problem_of(synth::make_point_problem(6, 5, 200, 0.2, 0));
  Image unmatched;
  unmatched.name = "stranger";
  unmatched.features = problem.images[0].features;
  problem.images.push_back(unmatched);
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

TEST(Reconstruct, PureRotationGivesReasonAndNoModel) {
  synth::PointProblem truth = synth::make_point_problem(7, 3, 300, 0, 0);
  truth.observations.clear();
  // All cameras at the place of the first.
  const Eigen::Vector3d center = truth.poses[0].center();
  for (int i = 0; i < 3; ++i) {
    auto& pose = truth.poses[static_cast<std::size_t>(i)];
    pose.rotation = truth.poses[0].rotation;
    const double turn = 0.03 * i;
    pose.rotation =
        Eigen::Matrix3d{
            {std::cos(turn), 0, std::sin(turn)}, {0, 1, 0}, {-std::sin(turn), 0, std::cos(turn)}} *
        pose.rotation;
    pose.translation = -(pose.rotation * center);
    for (std::size_t p = 0; p < truth.points.size(); ++p) {
      const auto pixel = truth.camera.project(pose * truth.points[p]);
      if (pixel && pixel->x >= 0 && pixel->y >= 0 && pixel->x < 639 && pixel->y < 479)
        truth.observations.push_back({i, static_cast<int>(p), *pixel, false});
    }
  }
  const Reconstruction built = run(problem_of(truth));
  EXPECT_TRUE(built.models.empty());
  EXPECT_THAT(built.no_model, HasSubstr("sideways"));
}

TEST(Reconstruct, RefinesWrongFocalLength) {
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

}  // namespace
}  // namespace tarsier::sfm
