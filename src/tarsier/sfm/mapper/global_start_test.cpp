// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/global_start.h"

#include "tarsier/core/testing_long.h"
#include "tarsier/geometry/sim3.h"
#include "tarsier/sfm/mapper/open_loops.h"
#include "tarsier/sfm/mapper/repeated_structure.h"
#include "tarsier/sfm/mapper/testing_centers.h"
#include "tarsier/sfm/mapper/trust.h"
#include "tarsier/synth/observed_site.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cstdlib>
#include <numeric>
#include <string>

namespace tarsier::sfm {
namespace {

using testing::HasSubstr;

// A site as the mapper takes it.
struct Given {
  synth::ObservedSite site;
  std::vector<geometry::Camera> cameras;
  std::vector<Image> images;
  std::vector<std::vector<cv::Vec3b>> colors;
  std::vector<Pair> pairs;
};

Given given(const synth::SiteOptions& options) {
  Given result;
  result.site = synth::make_observed_site(options);
  result.cameras = {result.site.camera};
  for (std::size_t i = 0; i < result.site.poses.size(); ++i) {
    Image image;
    image.name = std::to_string(i);
    image.features = result.site.features[i];
    result.colors.emplace_back(image.features.size(), cv::Vec3b(1, 2, 3));
    result.images.push_back(std::move(image));
  }
  for (const auto& known : result.site.pairs) {
    std::vector<Match> matches;
    for (const auto& [first, second] : known.matches) matches.push_back({first, second});
    Pair pair;
    pair.first = known.first;
    pair.second = known.second;
    pair.matches = static_cast<int>(matches.size());
    pair.view = verify_pair(result.images[static_cast<std::size_t>(pair.first)].features,
                            result.images[static_cast<std::size_t>(pair.second)].features, matches,
                            result.site.camera, result.site.camera, {});
    result.pairs.push_back(std::move(pair));
  }
  return result;
}

Given given(synth::SiteKind kind, int images, int features = 200, int neighbours = 8) {
  synth::SiteOptions options;
  options.kind = kind;
  options.images = images;
  options.features = features;
  options.neighbours = neighbours;
  return given(options);
}

Reconstruction run(const Given& given, MapperChoice choice, int auto_global = 250,
                   const MapperHooks& hooks = {}, Progress&& progress = NoProgress(),
                   const std::stop_token& stop = {}) {
  MapperOptions options;
  options.choice = choice;
  options.auto_global = auto_global;
  const std::vector<cv::Mat> no_descriptors;
  return reconstruct({.cameras = given.cameras,
                      .images = given.images,
                      .colors = given.colors,
                      .descriptors = no_descriptors,
                      .kind = FeatureKind::kSift,
                      .pairs = given.pairs},
                     options, progress, stop, hooks);
}

int registered(const Reconstruction& built) {
  return built.models.empty() ? 0 : statistics_of(built.models[0]).registered;
}

void expect_same(const Reconstruction& built, const Reconstruction& expected) {
  EXPECT_EQ(built.log, expected.log);
  ASSERT_EQ(built.models.size(), expected.models.size());
  for (std::size_t i = 0; i < expected.models[0].images.size(); ++i)
    EXPECT_EQ(built.models[0].images[i].pose.translation,
              expected.models[0].images[i].pose.translation);
}

TEST(GlobalMapper, ALoopAndAFlightAreWhole) {
  for (const synth::SiteKind kind : {synth::SiteKind::kRing, synth::SiteKind::kGrid}) {
    const Given site = given(kind, 50);
    const Reconstruction built = run(site, MapperChoice::kGlobal);
    ASSERT_EQ(built.models.size(), 1U);
    EXPECT_EQ(registered(built), 50);
    EXPECT_LT(worst_center(built.models[0], site.site.poses), 0.003);
    EXPECT_GT(built.trust[0], 0.8);
    EXPECT_TRUE(built.outcomes[7].registered);
    EXPECT_GT(built.outcomes[7].trust, 0.5);
  }
}

TEST(GlobalMapper, TheNumberOfThreadsChangesNothing) {
  const Given site = given(synth::SiteKind::kRing, 40);
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

TEST(GlobalMapper, PairsThatContradictEachOtherAreRefusedWithAReason) {
  Given site = given(synth::SiteKind::kRing, 30);
  for (std::size_t k = 0; k < site.pairs.size(); ++k) {
    geometry::Rigid3& pose = site.pairs[k].view.second_from_first;
    const auto turn = static_cast<double>(k);
    pose.rotation =
        geometry::rotation_by({std::sin(7 * turn), 3 * std::sin(5 * turn), turn}) * pose.rotation;
  }
  const Reconstruction built = run(site, MapperChoice::kGlobal);
  EXPECT_TRUE(built.models.empty());
  EXPECT_THAT(built.no_model, HasSubstr("global mapping refused: only "));
  EXPECT_THAT(built.outcomes[3].reason, HasSubstr("global mapping refused"));
  // Image by image the relative rotations do not matter beyond the first pair.
  EXPECT_THAT(run(site, MapperChoice::kAuto, 20).log, testing::Contains(HasSubstr("start from")));
}

TEST(GlobalMapper, TheSidesOfASymmetricalThingAreNotFolded) {
  const Given site = given(synth::SiteKind::kSymmetric, 80);
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

// With these neighbours both mappers lay all four sides over each other at first.
TEST(MapperOfRepeats, AModelThatIsFoldedIsTakenApart) {
  const Given site = given(synth::SiteKind::kSymmetric, 80, 300, 12);
  for (const MapperChoice choice : {MapperChoice::kIncremental, MapperChoice::kGlobal}) {
    const Reconstruction built = run(site, choice);
    ASSERT_FALSE(built.models.empty());
    EXPECT_GE(registered(built), 76);
    EXPECT_LT(worst_center(built.models[0], site.site.poses), 0.005);
    EXPECT_GT(built.trust[0], 0.8);
    EXPECT_THAT(built.log, testing::Contains(HasSubstr("lays different places over each other")));
    EXPECT_TRUE(
        std::any_of(built.refused.begin(), built.refused.end(), [](const RefusedPair& pair) {
          return pair.reason.find("lays different places") != std::string::npos;
        }));
  }
}

// The models of the strongest pairs of this prism are folded, and by these pairs alone they have no conflicts.
TEST(MapperOfRepeats, AModelIsJudgedAlsoByThePairsThatItWasMadeWithout) {
  TARSIER_LONG_TEST();
  synth::SiteOptions options;
  options.kind = synth::SiteKind::kSymmetric;
  options.images = 60;
  options.sides = 6;
  options.details = 0.15;
  options.seed = 3;
  const Given site = given(options);
  const Reconstruction built = run(site, MapperChoice::kAuto);
  EXPECT_THAT(built.log, testing::Contains(HasSubstr("score of the models")));
  ASSERT_FALSE(built.models.empty());
  EXPECT_EQ(registered(built), 60);
  EXPECT_LT(worst_center(built.models[0], site.site.poses), 0.005);
  EXPECT_GT(built.trust[0], 0.8);
}

// An image by image model that is taken up from any checkpoint ends the same, also after it was taken apart.
TEST(MapperOfRepeats, ACheckpointKnowsThatAModelWasTakenApart) {
  TARSIER_LONG_TEST();
  const Given site = given(synth::SiteKind::kSymmetric, 80, 300, 12);
  std::vector<MapperState> states;
  MapperHooks hooks;
  hooks.keep = [&](const MapperState& state) { states.push_back(state); };
  hooks.keep_every_s = 0;
  const auto mapped = [&] { return run(site, MapperChoice::kIncremental, 250, hooks); };
  const Reconstruction whole = mapped();
  const auto apart = std::find_if(states.begin(), states.end(), [](const MapperState& state) {
    return std::any_of(state.log.begin(), state.log.end(), [](const std::string& line) {
      return line.find("lays different") != std::string::npos;
    });
  });
  ASSERT_NE(apart, states.end());
  hooks.from = *apart;
  hooks.keep = nullptr;
  const Reconstruction resumed = mapped();
  expect_same(resumed, whole);
}

// Stops the work when the images are mapped for the second time.
class StopsTheSecondTime final : public Progress {
 public:
  explicit StopsTheSecondTime(std::stop_source& stop) : stop_(stop) {}
  void begin(std::string_view /*stage*/, std::int64_t /*total*/,
             std::string_view /*unit*/) override {
    if (++begun_ == 2) stop_.request_stop();
  }
  void advance(std::int64_t /*count*/) override {}
  void end() override {}

 private:
  std::stop_source& stop_;
  int begun_ = 0;
};

// Nothing has been made of its images again, and a model of little trust is better than none.
TEST(MapperOfRepeats, InterruptedTheModelThatWasTakenApartIsLeft) {
  TARSIER_LONG_TEST();
  const Given site = given(synth::SiteKind::kSymmetric, 80, 300, 12);
  std::stop_source stop;
  MapperHooks hooks;
  hooks.partial = true;
  const Reconstruction built =
      run(site, MapperChoice::kIncremental, 250, hooks, StopsTheSecondTime(stop), stop.get_token());
  EXPECT_TRUE(built.interrupted);
  ASSERT_THAT(built.log, testing::Contains(HasSubstr("lays different places over each other")));
  ASSERT_EQ(built.models.size(), 1U);
  EXPECT_EQ(registered(built), 80);
  EXPECT_LT(built.trust[0], 0.5);
}

// Few and noisy observations of a long ring: image by image its ends do not meet.
Given drifting_ring() {
  synth::SiteOptions options;
  options.kind = synth::SiteKind::kRing;
  options.images = 200;
  options.features = 150;
  options.neighbours = 4;
  options.noise_px = 1.5;
  return given(options);
}

TEST(MapperOfLoops, ALoopThatIsLeftOpenIsClosedByGlobalMapping) {
  TARSIER_LONG_TEST();
  const Given site = drifting_ring();
  std::vector<MapperState> states;
  MapperHooks hooks;
  hooks.keep = [&](const MapperState& state) { states.push_back(state); };
  hooks.keep_every_s = 0;
  const auto mapped = [&] { return run(site, MapperChoice::kIncremental, 250, hooks); };
  const Reconstruction whole = mapped();
  EXPECT_THAT(whole.log, testing::Contains(HasSubstr("pairs open")));
  EXPECT_THAT(whole.log, testing::Contains(HasSubstr("the second is kept")));
  EXPECT_THAT(whole.log, testing::Contains(HasSubstr("start from")));
  EXPECT_EQ(registered(whole), 200);
  EXPECT_LT(worst_center(whole.models[0], site.site.poses), 0.02);

  // A checkpoint has the model that was set aside.
  const auto aside = std::find_if(states.begin(), states.end(),
                                  [](const MapperState& state) { return state.has_aside; });
  ASSERT_LT(aside + 2, states.end());
  hooks.from = *(aside + 2);
  hooks.keep = nullptr;
  const Reconstruction resumed = mapped();
  expect_same(resumed, whole);
}

TEST(MapperOfLoops, OpenOnesAreFoundInABentModel) {
  const Given site = given(synth::SiteKind::kRing, 80, 100, 4);
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

TEST(RepeatedStructure, FewTruePairsAreRefusedAndManyWrongOnes) {
  const Given site = given(synth::SiteKind::kSymmetric, 80, 300, 12);
  const std::vector<PairEvidence> evidence = check_evidence(site.cameras, site.images, site.pairs);
  int refused_true = 0;
  int refused_wrong = 0;
  for (std::size_t k = 0; k < evidence.size(); ++k)
    if (evidence[k].is_refused()) ++(site.site.pairs[k].same_place ? refused_true : refused_wrong);
  EXPECT_GT(refused_wrong, 10);
  EXPECT_LT(refused_true, 5);
}

TEST(Trust, AnImageInTheWrongPlaceComesLast) {
  const Given site = given(synth::SiteKind::kRing, 40);
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
