// SPDX-License-Identifier: MIT
#include "tarsier/core/progress.h"
#include "tarsier/core/testing_long.h"
#include "tarsier/sfm/mapper/testing_centers.h"
#include "tarsier/sfm/mapper/testing_reconstruction.h"
#include "tarsier/sfm/mapper/testing_site.h"
#include "tarsier/sfm/reconstruction/reconstruct.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

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
  return reconstruct(input_of(given), options_of(choice, auto_global), progress, stop, hooks);
}

// With these neighbours, both mappers first map all four sides onto each other.
TEST(RepeatedStructureMapper, RemapsFoldedModel) {
  const TestSite site = given(synth::SiteKind::kSymmetric, 80, 300, 12);
  for (const MapperChoice choice : {MapperChoice::kIncremental, MapperChoice::kGlobal}) {
    const Reconstruction built = run(site, choice);
    ASSERT_FALSE(built.models.empty());
    EXPECT_GE(registered(built), 76);
    EXPECT_LT(worst_center(built.models[0], site.site.poses), 0.005);
    EXPECT_GT(built.trust[0], 0.8);
    EXPECT_THAT(built.log, testing::Contains(HasSubstr("superimposes different places")));
    EXPECT_TRUE(std::any_of(
        built.refused.begin(), built.refused.end(),
        [](const RefusedPair& pair) { return pair.rejection == PairRejection::kModelConflict; }));
  }
}

// The models of this prism's strongest pairs are folded, but those pairs alone show no conflict.
TEST(RepeatedStructureMapper, EvaluatesModelByUnusedPairsToo) {
  TARSIER_LONG_TEST();
  synth::SiteOptions options;
  options.kind = synth::SiteKind::kSymmetric;
  options.images = 60;
  options.sides = 6;
  options.details = 0.15;
  options.seed = 3;
  const TestSite site = given(options);
  Reconstruction built;
  const std::vector<MapperState> states = states_of(
      [&](const MapperHooks& hooks) { return run(site, MapperChoice::kAuto, 250, hooks); }, built);
  EXPECT_THAT(built.log, testing::Contains(HasSubstr("score of the models")));
  ASSERT_FALSE(built.models.empty());
  EXPECT_EQ(registered(built), 60);
  EXPECT_LT(worst_center(built.models[0], site.site.poses), 0.005);
  EXPECT_GT(built.trust[0], 0.8);

  // From a checkpoint in the middle of each attempt, the result is the same. Earlier ones are not
  // mapped again.
  ASSERT_GE(states.back().attempts.size(), 3U);
  for (std::size_t attempts = 1; attempts <= states.back().attempts.size(); ++attempts) {
    std::vector<const MapperState*> of_attempt;
    for (const MapperState& state : states)
      if (state.attempts.size() == attempts && !state.attempts.back().done)
        of_attempt.push_back(&state);
    ASSERT_FALSE(of_attempt.empty());
    MapperHooks hooks;
    hooks.resume_from = *of_attempt[of_attempt.size() / 2];
    hooks.save_interval_s = 0;
    std::size_t unfinished = 0;  // attempts that were not finished
    hooks.save_checkpoint = [&](const MapperState& state) {
      EXPECT_GE(state.attempts.size(), attempts);
      for (std::size_t k = 0; k + 1 < attempts; ++k) unfinished += state.attempts[k].done ? 0 : 1;
    };
    expect_same(run(site, MapperChoice::kAuto, 250, hooks), built);
    EXPECT_EQ(unfinished, 0U);
  }

  // An interruption leaves the models from before the attempts, and their checkpoint.
  std::stop_source stop;
  MapperHooks hooks;
  hooks.partial = true;
  hooks.save_interval_s = 0;
  std::optional<MapperState> kept;
  hooks.save_checkpoint = [&](const MapperState& state) {
    kept = state;
    if (state.attempts.size() == 2) stop.request_stop();
  };
  const Reconstruction part =
      run(site, MapperChoice::kAuto, 250, hooks, NoProgress(), stop.get_token());
  EXPECT_TRUE(part.interrupted);
  EXPECT_FALSE(part.models.empty());
  ASSERT_TRUE(kept);
  hooks = {};
  hooks.resume_from = kept;
  expect_same(run(site, MapperChoice::kAuto, 250, hooks), built);
}

// An incremental model that continues from any checkpoint ends the same, also after it was taken
// apart.
TEST(RepeatedStructureMapper, ResumesAfterConflictingModel) {
  TARSIER_LONG_TEST();
  const TestSite site = given(synth::SiteKind::kSymmetric, 80, 300, 12);
  std::vector<MapperState> states;
  MapperHooks hooks;
  hooks.save_checkpoint = [&](const MapperState& state) { states.push_back(state); };
  hooks.save_interval_s = 0;
  const auto mapped = [&] { return run(site, MapperChoice::kIncremental, 250, hooks); };
  const Reconstruction whole = mapped();
  const auto conflict = std::find_if(states.begin(), states.end(), [](const MapperState& state) {
    return std::any_of(state.log.begin(), state.log.end(), [](const std::string& line) {
      return line.find("superimposes different places") != std::string::npos;
    });
  });
  ASSERT_NE(conflict, states.end());
  hooks.resume_from = *conflict;
  hooks.save_checkpoint = nullptr;
  const Reconstruction resumed = mapped();
  expect_same(resumed, whole);
}

// Stops the work when the images are mapped for the second time.
class StopsAtSecondMapping final : public Progress {
 public:
  explicit StopsAtSecondMapping(std::stop_source& stop) : stop_(stop) {}
  void begin(std::string_view /*stage*/, std::int64_t /*total*/,
             std::string_view /*unit*/) override {
    if (++mappings_ == 2) stop_.request_stop();
  }
  void advance(std::int64_t /*count*/) override {}
  void end() override {}

 private:
  std::stop_source& stop_;
  int mappings_ = 0;
};

// No second model exists yet, and a model of low trust is better than none.
TEST(RepeatedStructureMapper, InterruptionReturnsConflictingModel) {
  TARSIER_LONG_TEST();
  const TestSite site = given(synth::SiteKind::kSymmetric, 80, 300, 12);
  std::stop_source stop;
  MapperHooks hooks;
  hooks.partial = true;
  const Reconstruction built = run(site, MapperChoice::kIncremental, 250, hooks,
                                   StopsAtSecondMapping(stop), stop.get_token());
  EXPECT_TRUE(built.interrupted);
  ASSERT_THAT(built.log, testing::Contains(HasSubstr("superimposes different places")));
  ASSERT_EQ(built.models.size(), 1U);
  EXPECT_EQ(registered(built), 80);
  EXPECT_LT(built.trust[0], 0.5);
}

}  // namespace
}  // namespace tarsier::sfm
