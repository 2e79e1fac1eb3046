// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/global_start.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/testing_long.h"
#include "tarsier/geometry/sim3.h"
#include "tarsier/sfm/consistency/open_loops.h"
#include "tarsier/sfm/consistency/repeated_structure.h"
#include "tarsier/sfm/consistency/trust.h"
#include "tarsier/sfm/mapper/mapping.h"
#include "tarsier/sfm/mapper/outcomes.h"
#include "tarsier/sfm/mapper/testing_centers.h"
#include "tarsier/sfm/mapper/testing_reconstruction.h"
#include "tarsier/sfm/mapper/testing_site.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cstdlib>
#include <numeric>
#include <optional>
#include <set>
#include <stop_token>
#include <string>
#include <tuple>

namespace tarsier::sfm {
namespace {

using test_support::expect_same;
using test_support::given;
using test_support::input_of;
using test_support::options_of;
using test_support::registered;
using test_support::states_of;
using test_support::TestSite;

using testing::HasSubstr;

Reconstruction run(const TestSite& given, MapperChoice choice, int auto_global = 250,
                   const MapperHooks& hooks = {}, Progress&& progress = NoProgress(),
                   const std::stop_token& stop = {}) {
  return map_images(input_of(given), options_of(choice, auto_global), progress, stop, hooks)
      .reconstruction;
}

// Two rings without pairs between them, and a few pairs that contradict the others.
TestSite two_rings() {
  TestSite result = given(synth::SiteKind::kRing, 30);
  TestSite other = given(synth::SiteKind::kRing, 24, 150);
  const int shift = 30;
  for (Image& image : other.images) {
    image.name += "b";
    result.images.push_back(std::move(image));
  }
  for (auto& colors : other.colors) result.colors.push_back(std::move(colors));
  for (Pair& pair : other.pairs) {
    pair.first += shift;
    pair.second += shift;
    result.pairs.push_back(std::move(pair));
  }
  for (std::size_t k = 7; k < result.pairs.size(); k += 40) {
    geometry::Rigid3& pose = result.pairs[k].view.second_from_first;
    pose.rotation = geometry::rotation_by({0, 0.4, 0}) * pose.rotation;
  }
  return result;
}

TEST(GlobalCheckpoints, ResumingFromAnyStepGivesSameResult) {
  const TestSite site = two_rings();
  Reconstruction whole;
  const std::vector<MapperState> states = states_of(
      [&](const MapperHooks& hooks) { return run(site, MapperChoice::kGlobal, 250, hooks); },
      whole);
  ASSERT_EQ(whole.models.size(), 2U);
  std::set<std::tuple<std::size_t, int, int>> seen;  // number of finished models, step, round
  for (const MapperState& state : states) {
    if (!state.start) continue;
    EXPECT_FALSE(state.current);
    const auto here = std::tuple(state.models.size(), state.start->step, state.start->round);
    if (!seen.insert(here).second) continue;
    MapperHooks hooks;
    hooks.resume_from = state;
    hooks.save_interval_s = 0;
    std::optional<MapperState> next;
    hooks.save_checkpoint = [&](const MapperState& kept) {
      if (!next) next = kept;
    };
    expect_same(run(site, MapperChoice::kGlobal, 250, hooks), whole);
    // Finished work is not done again.
    ASSERT_TRUE(next);
    if (next->start) {
      EXPECT_GT(std::tuple(next->models.size(), next->start->step, next->start->round), here);
    }
  }
  for (std::size_t models = 0; models < 2; ++models) {
    EXPECT_TRUE(seen.contains({models, GlobalStartState::kRotations, 0}));
    EXPECT_TRUE(seen.contains({models, GlobalStartState::kPositions, 0}));
    for (int round = 0; round <= 4; ++round)
      EXPECT_TRUE(seen.contains({models, GlobalStartState::kAdjustment, round}));
  }
}

TEST(GlobalCheckpoints, IgnoresThoseOfOtherPairs) {
  const TestSite site = given(synth::SiteKind::kRing, 30);
  Reconstruction whole;
  std::vector<MapperState> states = states_of(
      [&](const MapperHooks& hooks) { return run(site, MapperChoice::kGlobal, 250, hooks); },
      whole);
  const auto adjusted = std::find_if(states.begin(), states.end(), [](const MapperState& state) {
    return state.start && state.start->step == GlobalStartState::kAdjustment;
  });
  ASSERT_NE(adjusted, states.end());
  MapperHooks hooks;
  hooks.resume_from = *adjusted;
  hooks.resume_from->start->points.pop_back();  // other tracks than those of the checkpoint
  expect_same(run(site, MapperChoice::kGlobal, 250, hooks), whole);
  hooks.resume_from = *adjusted;
  hooks.resume_from->start->nodes.pop_back();  // edges refer to the missing node
  hooks.resume_from->start->rotations.pop_back();
  expect_same(run(site, MapperChoice::kGlobal, 250, hooks), whole);
}

// A refused global mapping is tried and reported only once.
TEST(GlobalCheckpoints, LogsRefusalOnce) {
  TestSite site = given(synth::SiteKind::kRing, 30);
  for (std::size_t k = 0; k < site.pairs.size(); ++k) {
    geometry::Rigid3& pose = site.pairs[k].view.second_from_first;
    pose.rotation =
        geometry::rotation_by({0, static_cast<double>(k), 0.3 * static_cast<double>(k * k)}) *
        pose.rotation;
  }
  std::optional<MapperState> kept;
  MapperHooks hooks;
  hooks.save_interval_s = 0;
  hooks.save_checkpoint = [&](const MapperState& state) {
    if (!kept) kept = state;
  };
  const Reconstruction whole = run(site, MapperChoice::kAuto, 20, hooks);
  const auto refusals = [](const std::vector<std::string>& log) {
    return std::count_if(log.begin(), log.end(),
                         [](const std::string& line) { return line.starts_with(kGlobalFailure); });
  };
  ASSERT_EQ(refusals(whole.log), 1);
  ASSERT_TRUE(kept && kept->start);
  // The state between the refusal and the first pair.
  kept->start->step = GlobalStartState::kRefused;
  for (const std::string& line : whole.log) {
    kept->log.push_back(line);
    if (line.starts_with(kGlobalFailure)) break;
  }
  hooks.resume_from = kept;
  hooks.save_checkpoint = nullptr;
  expect_same(run(site, MapperChoice::kAuto, 20, hooks), whole);
}

TEST(GlobalMapper, InterruptionReturnsPartialModel) {
  const TestSite site = given(synth::SiteKind::kRing, 40);
  const Reconstruction whole = run(site, MapperChoice::kGlobal);
  const auto stopped_at = [&](int step, int round, std::optional<MapperState>& kept) {
    std::stop_source stop;
    MapperHooks hooks;
    hooks.partial = true;
    hooks.save_interval_s = 0;
    hooks.save_checkpoint = [&](const MapperState& state) {
      kept = state;
      if (state.start && state.start->step == step && state.start->round == round)
        stop.request_stop();
    };
    return run(site, MapperChoice::kGlobal, 250, hooks, NoProgress(), stop.get_token());
  };
  std::optional<MapperState> kept;
  EXPECT_THROW((void)stopped_at(GlobalStartState::kRotations, 0, kept), Interrupted);
  EXPECT_THROW((void)stopped_at(GlobalStartState::kPositions, 0, kept), Interrupted);
  for (const int round : {0, 2}) {
    const Reconstruction part = stopped_at(GlobalStartState::kAdjustment, round, kept);
    EXPECT_TRUE(part.interrupted);
    ASSERT_EQ(part.models.size(), 1U);
    EXPECT_EQ(registered(part), 40);
    EXPECT_GT(part.models[0].points.size(), 500U);
    EXPECT_LT(worst_center(part.models[0], site.site.poses), 0.05);
    EXPECT_TRUE(part.outcomes[7].registered);
    const Model& model = part.models[0];
    for (std::size_t p = 0; p < model.points.size(); ++p)
      for (const Observation& seen : model.points[p].track)
        EXPECT_EQ(model.images[static_cast<std::size_t>(seen.image)]
                      .points[static_cast<std::size_t>(seen.feature)],
                  static_cast<int>(p));
    MapperHooks hooks;
    hooks.resume_from = kept;
    expect_same(run(site, MapperChoice::kGlobal, 250, hooks), whole);
  }
}

TEST(GlobalMapper, RegistersAllImagesOfRingAndGrid) {
  for (const synth::SiteKind kind : {synth::SiteKind::kRing, synth::SiteKind::kGrid}) {
    const TestSite site = given(kind, 50);
    const Reconstruction built = run(site, MapperChoice::kGlobal);
    ASSERT_EQ(built.models.size(), 1U);
    EXPECT_EQ(registered(built), 50);
    EXPECT_LT(worst_center(built.models[0], site.site.poses), 0.003);
    EXPECT_GT(built.trust[0], 0.8);
    EXPECT_TRUE(built.outcomes[7].registered);
    EXPECT_GT(built.outcomes[7].trust, 0.5);
  }
}

TEST(GlobalMapper, ResultDoesNotDependOnNumberOfThreads) {
  const TestSite site = given(synth::SiteKind::kRing, 40);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const Reconstruction one = run(site, MapperChoice::kGlobal);
  cv::setNumThreads(3);
  const Reconstruction three = run(site, MapperChoice::kGlobal);
  cv::setNumThreads(threads);
  ASSERT_EQ(one.models.size(), three.models.size());
  EXPECT_EQ(one.log, three.log);
  for (std::size_t i = 0; i < site.images.size(); ++i) {
    const geometry::Rigid3& a = one.models[0].images[i].pose;
    const geometry::Rigid3& b = three.models[0].images[i].pose;
    EXPECT_EQ(a.rotation, b.rotation);
    EXPECT_EQ(a.translation, b.translation);
  }
}

TEST(GlobalMapper, RefusesContradictingPairsWithReason) {
  TestSite site = given(synth::SiteKind::kRing, 30);
  for (std::size_t k = 0; k < site.pairs.size(); ++k) {
    geometry::Rigid3& pose = site.pairs[k].view.second_from_first;
    const auto turn = static_cast<double>(k);
    pose.rotation =
        geometry::rotation_by({std::sin(7 * turn), 3 * std::sin(5 * turn), turn}) * pose.rotation;
  }
  const Reconstruction built = run(site, MapperChoice::kGlobal);
  EXPECT_TRUE(built.models.empty());
  EXPECT_THAT(built.no_model, HasSubstr("global mapping failed: only "));
  EXPECT_THAT(built.outcomes[3].reason, HasSubstr("global mapping failed"));
  // Incremental mapping does not use the relative rotations after the first pair.
  EXPECT_THAT(run(site, MapperChoice::kAuto, 20).log, testing::Contains(HasSubstr("initial pair")));
}

TEST(GlobalMapper, DoesNotFoldSymmetricObject) {
  const TestSite site = given(synth::SiteKind::kSymmetric, 80);
  const auto wrong = std::count_if(site.site.pairs.begin(), site.site.pairs.end(),
                                   [](const auto& pair) { return !pair.same_place; });
  ASSERT_GT(wrong, 20);
  const Reconstruction built = run(site, MapperChoice::kGlobal);
  ASSERT_FALSE(built.models.empty());
  EXPECT_GE(registered(built), 76);
  EXPECT_LT(worst_center(built.models[0], site.site.poses), 0.005);
  ASSERT_FALSE(built.refused.empty());
  EXPECT_FALSE(built.refused[0].reason.empty());
}

// A long ring with few, noisy observations. Incremental mapping does not close it.
TestSite drifting_ring() {
  synth::SiteOptions options;
  options.kind = synth::SiteKind::kRing;
  options.images = 200;
  options.features = 150;
  options.neighbours = 4;
  options.noise_px = 1.5;
  return given(options);
}

TEST(LoopClosure, GlobalMappingClosesOpenLoop) {
  TARSIER_LONG_TEST();
  const TestSite site = drifting_ring();
  std::vector<MapperState> states;
  MapperHooks hooks;
  hooks.save_checkpoint = [&](const MapperState& state) { states.push_back(state); };
  hooks.save_interval_s = 0;
  const auto mapped = [&] { return run(site, MapperChoice::kIncremental, 250, hooks); };
  const Reconstruction whole = mapped();
  EXPECT_THAT(whole.log, testing::Contains(HasSubstr("does not close its loops")));
  EXPECT_THAT(whole.log, testing::Contains(HasSubstr("the global model is used")));
  EXPECT_THAT(whole.log, testing::Contains(HasSubstr("initial pair")));
  EXPECT_EQ(registered(whole), 200);
  EXPECT_LT(worst_center(whole.models[0], site.site.poses), 0.02);

  // The checkpoint contains the model that was set aside.
  const auto open_loop = std::find_if(states.begin(), states.end(), [](const MapperState& state) {
    return state.has_open_loop_model;
  });
  ASSERT_LT(open_loop + 2, states.end());
  hooks.resume_from = *(open_loop + 2);
  hooks.save_checkpoint = nullptr;
  const Reconstruction resumed = mapped();
  expect_same(resumed, whole);
  const auto adjusted = std::find_if(open_loop, states.end(), [](const MapperState& state) {
    return state.has_open_loop_model && state.start &&
           state.start->step == GlobalStartState::kAdjustment;
  });
  ASSERT_NE(adjusted, states.end());
  hooks.resume_from = *adjusted;
  expect_same(mapped(), whole);
}

TEST(LoopClosure, FindsOpenLoopsInBentModel) {
  const TestSite site = given(synth::SiteKind::kRing, 80, 100, 4);
  Model model;
  model.cameras = site.cameras;
  model.images = site.images;
  std::vector<const Pair*> pairs;
  for (const Pair& pair : site.pairs) pairs.push_back(&pair);
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    model.images[i].registered = true;
    model.images[i].pose = site.site.poses[i];
  }
  EXPECT_TRUE(open_loops(model, pairs).empty());
  const double before = agreeing_inliers(model, pairs);
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    const double angle = 0.003 * static_cast<double>(i);
    model.images[i].pose.rotation =
        geometry::rotation_by({0, angle, 0}) * model.images[i].pose.rotation;
  }
  const std::vector<const Pair*> open = open_loops(model, pairs);
  ASSERT_FALSE(open.empty());
  for (const Pair* pair : open) EXPECT_GT(std::abs(pair->first - pair->second), 70);
  EXPECT_LT(agreeing_inliers(model, pairs), before);
}

TEST(RepeatedStructure, RefusesManyWrongAndFewCorrectPairs) {
  const TestSite site = given(synth::SiteKind::kSymmetric, 80, 300, 12);
  const std::vector<PairEvidence> evidence = check_evidence(site.cameras, site.images, site.pairs);
  int refused_true = 0;
  int refused_wrong = 0;
  for (std::size_t k = 0; k < evidence.size(); ++k)
    if (evidence[k].is_refused()) ++(site.site.pairs[k].same_place ? refused_true : refused_wrong);
  EXPECT_GT(refused_wrong, 10);
  EXPECT_LT(refused_true, 5);
}

TEST(Trust, IsLowestForMisplacedImage) {
  const TestSite site = given(synth::SiteKind::kRing, 40);
  Reconstruction built = run(site, MapperChoice::kGlobal);
  ASSERT_EQ(built.models.size(), 1U);
  Model& model = built.models[0];
  model.images[11].pose.rotation =
      geometry::rotation_by({0, 0.5, 0}) * model.images[11].pose.rotation;
  const std::vector<std::uint8_t> none(site.pairs.size(), 0);
  const std::vector<double> trust = trust_of(model, site.pairs, none);
  EXPECT_EQ(std::min_element(trust.begin(), trust.end()) - trust.begin(), 11);
  EXPECT_LT(model_trust(model, trust), built.trust[0]);
}

}  // namespace
}  // namespace tarsier::sfm
