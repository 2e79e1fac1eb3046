// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/start_poses.h"

#include "tarsier/core/rng.h"
#include "tarsier/sfm/mapper/mapping.h"
#include "tarsier/sfm/mapper/testing_centers.h"
#include "tarsier/synth/sfm_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::sfm {
namespace {

using testing::HasSubstr;

// Cameras on an arc and their features, matched by point identity.
class StartPosesTest : public testing::Test {
 protected:
  void make(double noise_px = 0.3, int images = 10) {
    truth_ = synth::make_point_problem(5, images, 400, noise_px, 0);
    cameras_ = {truth_.camera};
    images_.assign(truth_.poses.size(), {});
    std::vector<std::map<int, int>> feature_of(images_.size());
    for (const auto& seen : truth_.observations) {
      const auto i = static_cast<std::size_t>(seen.image);
      feature_of[i][seen.point] = static_cast<int>(images_[i].features.size());
      images_[i].features.emplace_back(seen.pixel);
    }
    colors_.clear();
    for (std::size_t i = 0; i < images_.size(); ++i) {
      images_[i].name = std::to_string(i);
      colors_.emplace_back(images_[i].features.size(), cv::Vec3b(1, 2, 3));
    }
    pairs_.clear();
    for (std::size_t a = 0; a < images_.size(); ++a) {
      for (std::size_t b = a + 1; b < images_.size(); ++b) {
        std::vector<Match> matches;
        for (const auto& [point, feature] : feature_of[a])
          if (feature_of[b].contains(point)) matches.push_back({feature, feature_of[b][point]});
        Pair pair;
        pair.first = static_cast<int>(a);
        pair.second = static_cast<int>(b);
        pair.matches = static_cast<int>(matches.size());
        pair.view = verify_pair(images_[a].features, images_[b].features, matches, truth_.camera,
                                truth_.camera, {});
        pairs_.push_back(std::move(pair));
      }
    }
  }

  // The true poses of the first images.
  [[nodiscard]] StartPoses first(int count) const {
    StartPoses start;
    start.poses.resize(truth_.poses.size());
    for (int i = 0; i < count; ++i)
      start.poses[static_cast<std::size_t>(i)] = truth_.poses[static_cast<std::size_t>(i)];
    return start;
  }

  [[nodiscard]] MapperInput input(const StartPoses& start) const {
    return {.cameras = cameras_,
            .images = images_,
            .colors = colors_,
            .descriptors = no_descriptors_,
            .kind = FeatureKind::kSift,
            .pairs = pairs_,
            .start = start};
  }

  [[nodiscard]] Reconstruction run(const StartPoses& start, const MapperOptions& options = {},
                                   const MapperHooks& hooks = {}) const {
    NoProgress progress;
    return map_images(input(start), options, progress, {}, hooks).reconstruction;
  }

  [[nodiscard]] StartCheck check(const StartPoses& start) const {
    return check_start(start, input(start), std::vector<char>(pairs_.size(), 0), 1.5, {});
  }

  // Randomly rotated by `degrees` and moved by `units`.
  static geometry::Rigid3 moved(const geometry::Rigid3& pose, double degrees, double units,
                                Rng& rng) {
    Eigen::Vector3d turn;
    Eigen::Vector3d step;
    for (int k = 0; k < 3; ++k) turn[k] = rng.normal();
    for (int k = 0; k < 3; ++k) step[k] = rng.normal();
    turn *= degrees * CV_PI / 180 / turn.norm();
    step *= units / step.norm();
    const Eigen::Matrix3d rotation = geometry::rotation_by(turn) * pose.rotation;
    return {rotation, -(rotation * (pose.center() + step))};
  }

  // Largest distance of a camera centre from the truth, without any alignment.
  [[nodiscard]] double worst(const Model& model) const {
    double result = 0;
    for (std::size_t i = 0; i < model.images.size(); ++i)
      if (model.images[i].registered)
        result =
            std::max(result, (model.images[i].pose.center() - truth_.poses[i].center()).norm());
    return result;
  }

  static int registered(const Model& model) {
    return static_cast<int>(std::count_if(model.images.begin(), model.images.end(),
                                          [](const Image& image) { return image.registered; }));
  }

  synth::PointProblem truth_;
  std::vector<geometry::Camera> cameras_;
  std::vector<Image> images_;
  std::vector<std::vector<cv::Vec3b>> colors_;
  const std::vector<cv::Mat> no_descriptors_;
  std::vector<Pair> pairs_;
};

TEST_F(StartPosesTest, ExtendToAllImagesInTheirFrame) {
  make();
  const Reconstruction made = run(first(6));
  ASSERT_EQ(made.models.size(), 1U);
  EXPECT_EQ(made.start_images, 6);
  EXPECT_EQ(registered(made.models[0]), 10);
  EXPECT_LT(worst(made.models[0]), 0.02);  // of an arc of about 10 units
  EXPECT_GT(made.models[0].points.size(), 300U);
  EXPECT_THAT(made.log.front(), HasSubstr("6 of 6 images have poses that agree"));
  for (const Outcome& outcome : made.outcomes) EXPECT_TRUE(outcome.registered) << outcome.reason;
}

TEST_F(StartPosesTest, FixedOnesStayAndOthersMove) {
  make();
  StartPoses start = first(6);
  start.fixed = true;
  const Reconstruction made = run(start);
  ASSERT_EQ(made.models.size(), 1U);
  const Model& model = made.models[0];
  EXPECT_EQ(registered(model), 10);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(model.images[i].pose.rotation, truth_.poses[i].rotation) << i;
    EXPECT_EQ(model.images[i].pose.translation, truth_.poses[i].translation) << i;
  }
  EXPECT_LT(worst(model), 0.02);
  // Without noise points are exact.
  make(0);
  start = first(10);
  start.fixed = true;
  const Reconstruction exact = run(start);
  ASSERT_EQ(exact.models.size(), 1U);
  ASSERT_GT(exact.models[0].points.size(), 300U);
  for (const Point& point : exact.models[0].points) EXPECT_LT(point.error, 1e-3);
}

TEST_F(StartPosesTest, RoughOnesAreRefined) {
  make();
  StartPoses start = first(10);
  Rng rng(3);
  for (auto& pose : start.poses) pose = moved(*pose, 0.8, 0.05, rng);
  const StartCheck checked = check(start);
  EXPECT_EQ(checked.accepted, 10);
  EXPECT_LT(checked.explained_share, 0.6);
  const Reconstruction made = run(start);
  ASSERT_EQ(made.models.size(), 1U) << made.no_model;
  EXPECT_EQ(registered(made.models[0]), 10);
  EXPECT_LT(worst_center(made.models[0], truth_.poses), 0.002);
  // The poses must not stay fixed: then most rays do not meet in a point.
  start.fixed = true;
  const Reconstruction fixed = run(start);
  const std::size_t points = fixed.models.empty() ? 0 : fixed.models[0].points.size();
  EXPECT_LT(points, made.models[0].points.size() / 2);
}

TEST_F(StartPosesTest, WrongPoseIsRejectedAndEstimatedAgain) {
  make();
  StartPoses start = first(8);
  Rng rng(4);
  start.poses[3] = moved(*start.poses[3], 40, 2, rng);
  const StartCheck checked = check(start);
  EXPECT_EQ(checked.accepted, 7);
  EXPECT_EQ(checked.fits[3], 0);
  EXPECT_THAT(checked.reasons[3], HasSubstr("contradicts its matches"));
  EXPECT_EQ(checked.refusal, "");
  const Reconstruction made = run(start);
  ASSERT_EQ(made.models.size(), 1U);
  EXPECT_EQ(made.start_images, 7);
  EXPECT_EQ(registered(made.models[0]), 10);
  EXPECT_LT(worst(made.models[0]), 0.02);
  // An image whose pose is fixed does not get another pose.
  start.fixed = true;
  const Reconstruction fixed = run(start);
  ASSERT_EQ(fixed.models.size(), 1U);
  EXPECT_FALSE(fixed.models[0].images[3].registered);
  EXPECT_THAT(fixed.outcomes[3].reason, HasSubstr("contradicts its matches"));
  EXPECT_EQ(registered(fixed.models[0]), 9);
}

TEST_F(StartPosesTest, ContradictingOnesAreRefused) {
  make();
  // Mirrored at the plane x = 0 of the world, as with the other handedness.
  StartPoses mirrored = first(8);
  const Eigen::Matrix3d mirror = Eigen::Vector3d(-1, 1, 1).asDiagonal();
  for (int i = 0; i < 8; ++i) {
    auto& pose = *mirrored.poses[static_cast<std::size_t>(i)];
    pose.rotation = mirror * pose.rotation * mirror;
    pose.translation = mirror * pose.translation;
  }
  // The poses of other images.
  StartPoses mixed = first(8);
  std::reverse(mixed.poses.begin(), mixed.poses.begin() + 8);
  StartPoses random = first(8);
  Rng rng(9);
  for (int i = 0; i < 8; ++i) {
    auto& pose = random.poses[static_cast<std::size_t>(i)];
    pose = moved(*pose, 60, 3, rng);
  }
  for (const StartPoses& start : {mirrored, mixed, random}) {
    const Reconstruction made = run(start);
    EXPECT_TRUE(made.models.empty());
    EXPECT_THAT(made.no_model,
                HasSubstr("the start model is rejected: it contradicts the matches"));
    EXPECT_EQ(made.start_images, check(start).accepted);
  }
}

TEST_F(StartPosesTest, WithoutMatchesAreRefused) {
  make();
  for (Pair& pair : pairs_)
    if (pair.first < 4 && pair.second < 4) pair.view.inliers = {};
  const Reconstruction made = run(first(4));
  EXPECT_TRUE(made.models.empty());
  EXPECT_THAT(made.no_model, HasSubstr("no pair of its 4 images has verified matches"));
}

TEST_F(StartPosesTest, ResumeFromCheckpoint) {
  make();
  StartPoses start = first(6);
  start.fixed = true;
  Rng rng(4);
  start.poses[2] = moved(*start.poses[2], 40, 2, rng);
  std::vector<MapperState> states;
  MapperHooks saving;
  saving.save_checkpoint = [&](const MapperState& state) { states.push_back(state); };
  saving.save_interval_s = 0;
  const Reconstruction whole = run(start, {}, saving);
  ASSERT_EQ(whole.models.size(), 1U);
  ASSERT_GT(states.size(), 5U);
  for (std::size_t k = 0; k < states.size(); k += 2) {
    MapperHooks from;
    from.resume_from = states[k];
    const Reconstruction again = run(start, {}, from);
    ASSERT_EQ(again.models.size(), 1U) << k;
    EXPECT_EQ(again.log, whole.log) << k;
    EXPECT_EQ(again.start_images, whole.start_images);
    for (std::size_t i = 0; i < images_.size(); ++i) {
      EXPECT_EQ(again.models[0].images[i].pose.translation,
                whole.models[0].images[i].pose.translation)
          << k << ' ' << i;
      EXPECT_EQ(again.outcomes[i].reason, whole.outcomes[i].reason) << k << ' ' << i;
    }
  }
}

TEST_F(StartPosesTest, KeepTheirLensWhileOthersAreRefined) {
  make(0.2);
  cameras_.push_back(truth_.camera);
  cameras_[1].fx *= 1.05;
  cameras_[1].fy *= 1.05;
  for (std::size_t i = 6; i < images_.size(); ++i) images_[i].camera = 1;
  StartPoses start = first(6);
  start.fixed_cameras = {0};
  MapperOptions options;
  options.refine_focal = true;
  const Reconstruction made = run(start, options);
  ASSERT_EQ(made.models.size(), 1U);
  const Model& model = made.models[0];
  EXPECT_EQ(registered(model), 10);
  EXPECT_EQ(model.cameras[0].fx, truth_.camera.fx);
  EXPECT_NEAR(model.cameras[1].fx / truth_.camera.fx, 1, 0.01);
}

}  // namespace
}  // namespace tarsier::sfm
