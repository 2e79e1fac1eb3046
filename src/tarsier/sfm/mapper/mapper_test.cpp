// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/mapper.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/sfm/bundle/bundle.h"
#include "tarsier/sfm/mapper/incremental_mapper.h"
#include "tarsier/sfm/mapper/testing_centers.h"
#include "tarsier/sfm/mapper/testing_reconstruction.h"
#include "tarsier/sfm/scene/align.h"
#include "tarsier/synth/sfm_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <stop_token>
#include <string>

namespace tarsier::sfm {
namespace {

using test_support::expect_same;

using testing::HasSubstr;

// A point problem in the form of the mapper's input: features, and matches by the points' identity.
struct Problem {
  synth::PointProblem truth;
  std::vector<geometry::Camera> cameras;
  std::vector<Image> images;
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
  for (const auto& seen : truth.observations) {
    const auto i = static_cast<std::size_t>(seen.image);
    problem.images[i].features.emplace_back(seen.pixel);
    problem.point_of[i].push_back(seen.point);
  }
  for (const Image& image : problem.images)
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

MapperInput input_of(const Problem& problem, const std::vector<cv::Mat>& descriptors) {
  return {.cameras = problem.cameras,
          .images = problem.images,
          .colors = problem.colors,
          .descriptors = descriptors,
          .kind = FeatureKind::kSift,
          .pairs = problem.pairs};
}

Reconstruction run(const Problem& problem, const MapperOptions& options = {}) {
  NoProgress progress;
  const std::vector<cv::Mat> no_descriptors;
  return reconstruct(input_of(problem, no_descriptors), options, progress, {});
}

// The same with descriptors that identify the points. Some matches are missing, so that extending
// the tracks can find them.
struct DescribedProblem {
  Problem problem;
  std::vector<cv::Mat> descriptors;
};

DescribedProblem described(const synth::PointProblem& truth) {
  DescribedProblem result{problem_of(truth), {}};
  Rng rng(77);
  std::map<int, std::vector<std::uint8_t>> descriptors;
  for (const std::vector<int>& points : result.problem.point_of) {
    cv::Mat rows(static_cast<int>(points.size()), 128, CV_8UC1);
    for (std::size_t f = 0; f < points.size(); ++f) {
      std::vector<std::uint8_t>& descriptor = descriptors[points[f]];
      while (descriptor.size() < 128)
        descriptor.push_back(static_cast<std::uint8_t>(rng.uniform() < 0.15 ? 120 : 5));
      std::copy(descriptor.begin(), descriptor.end(), rows.ptr(static_cast<int>(f)));
    }
    result.descriptors.push_back(rows);
  }
  for (Pair& pair : result.problem.pairs) {
    std::vector<Match> inliers = pair.view.inliers.copy();
    std::erase_if(inliers, [&](const Match&) { return rng.uniform() < 0.4; });
    pair.view.inliers = std::move(inliers);
  }
  return result;
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
