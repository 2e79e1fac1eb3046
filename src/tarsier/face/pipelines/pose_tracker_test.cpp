// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/pose_tracker.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/pipelines/testing_messi.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

namespace tarsier::face {
namespace {

using testing::HasSubstr;

const PoseModels& pose_models() {
  static const PoseModels shared = load_pose_models(models());
  return shared;
}

class PoseTrackerTest : public MessiTest {};

TEST_F(PoseTrackerTest, StillResultEqualsPoseFinder) {
  const PoseTracker tracker(pose_models(), {});
  PoseState state;
  const PoseResult result = tracker.process(frame(0, true), state);
  ASSERT_EQ(result.faces.size(), 1U);
  ASSERT_TRUE(result.faces[0].pose);
  EXPECT_FALSE(result.tracked);
  EXPECT_EQ(result.camera.width, image_.cols);
  // He looks down and to image right.
  EXPECT_NEAR(result.faces[0].pose->angles.yaw_deg, -33, 15);
  EXPECT_NEAR(result.faces[0].pose->angles.pitch_deg, -20, 12);

  cv::Mat gray;
  cv::cvtColor(image_, gray, cv::COLOR_BGR2GRAY);
  landmarks::FaceFinder finder = tracker.landmarks().detector().make_finder();
  landmarks::FitWorkspace workspace;
  const auto expected = tracker.finder().find(gray, result.camera, finder, workspace);
  EXPECT_EQ(to_json(result)["faces"], posed_faces_json(expected, false));
  EXPECT_EQ(to_json(result)["faces"][0]["rotation"].size(), 9U);
}

TEST_F(PoseTrackerTest, ReportsStandardDeviationsOfAngles) {
  const auto sigma_of = [&](const PoseTrackerOptions& options, int index, bool still,
                            PoseState& state) {
    const PoseTracker tracker = PoseTracker::load(models(), options);
    const PoseResult result = tracker.process(frame(index, still), state);
    const head::HeadPose& pose = result.faces.at(0).pose.value();
    const auto json = to_json(result)["faces"][0];
    EXPECT_NEAR(json["yaw_sigma_deg"], pose.yaw_sigma_deg, 0.006);
    EXPECT_NEAR(json["pitch_sigma_deg"], pose.pitch_sigma_deg, 0.006);
    EXPECT_NEAR(json["roll_sigma_deg"], pose.roll_sigma_deg, 0.006);
    return Eigen::Array3d(pose.yaw_sigma_deg, pose.pitch_sigma_deg, pose.roll_sigma_deg);
  };
  PoseState state;
  const Eigen::Array3d of_still = sigma_of({}, 0, true, state);
  EXPECT_GT(of_still.minCoeff(), 0.3);
  EXPECT_LT(of_still.maxCoeff(), 20);
  // Repeating the same image does not reduce the deviations, and its smoothed pose has no lag.
  PoseState moving;
  Eigen::Array3d of_video = of_still;
  for (int k = 0; k < 6; ++k) of_video = sigma_of({}, k, false, moving);
  EXPECT_LT(((of_video - of_still) / of_still).abs().maxCoeff(), 0.3);
  // Without refinement of the direction the expected errors differ.
  PoseTrackerOptions plain;
  plain.refine = false;
  PoseState other;
  EXPECT_GT((sigma_of(plain, 0, true, other) - of_still).abs().maxCoeff(), 0.05);
}

TEST_F(PoseTrackerTest, LearnsHeadShapesWithinAVideo) {
  const PoseTracker tracker(pose_models(), {});
  PoseState state;
  for (int k = 0; k < 3; ++k) {
    const PoseResult result = tracker.process(frame(k, false), state);
    ASSERT_EQ(result.faces.size(), 1U);
    EXPECT_EQ(to_json(result)["faces"][0]["id"], 1);
    EXPECT_EQ(state.persons.count(1), 1U);
  }
  redetect(state);
  EXPECT_TRUE(state.persons.empty());
  EXPECT_TRUE(state.landmarks.tracker.tracks.at(0).lost);
  static_cast<void>(tracker.process(frame(3, false), state));
  EXPECT_EQ(state.persons.count(1), 1U);
  state.persons.try_emplace(9, PoseTrackerOptions{});
  static_cast<void>(tracker.process(frame(0, false, "b/1.png"), state));
  EXPECT_EQ(state.persons.count(9), 0U);  // a person of another video
  static_cast<void>(tracker.process(frame(1, false, "b/2.png"), state));
  EXPECT_GT(state.persons.at(1).last_seen_s, 0);  // images in sequence are one video
  state.persons.try_emplace(9, PoseTrackerOptions{}).first->second.last_seen_s = 1;
  static_cast<void>(tracker.process(frame(2, false, "b/3.png"), state));
  EXPECT_EQ(state.persons.count(9), 1U);
}

TEST_F(PoseTrackerTest, AppearanceFitGivesThePosesOfItsPoints) {
  PoseTrackerOptions options;
  options.fit = PoseFit::kAam;
  const PoseTracker tracker = PoseTracker::load(models(), options);
  PoseState state;
  const PoseResult still = tracker.process(frame(0, true), state);
  ASSERT_EQ(still.faces.size(), 1U);
  ASSERT_TRUE(still.faces[0].pose);
  EXPECT_NEAR(still.faces[0].pose->angles.yaw_deg, -33, 15);
  AppearanceTrackerOptions of_points;
  of_points.start = AppearanceStart::kLandmarks;
  AppearanceState points;
  const auto expected =
      AppearanceTracker::load(models(), of_points).process(frame(0, true), points);
  ASSERT_EQ(expected.size(), 1U);
  EXPECT_EQ(still.faces[0].face.points, expected[0].fit.points);
  EXPECT_DOUBLE_EQ(still.faces[0].face.score, 1 - expected[0].fit.error);
  for (int k = 0; k < 3; ++k) {
    const PoseResult result = tracker.process(frame(k, false), state);
    ASSERT_EQ(result.faces.size(), 1U);
    EXPECT_EQ(result.faces[0].face.id, 1);
    EXPECT_TRUE(result.faces[0].pose);
  }
  EXPECT_THROW(PoseTracker(pose_models(), options), std::invalid_argument)
      << "no appearance model was loaded";
}

TEST_F(PoseTrackerTest, RejectsACameraOfAnotherAspect) {
  PoseTrackerOptions options;
  options.camera = head::guess_camera({100, 900});
  PoseState state;
  EXPECT_THROW(
      static_cast<void>(PoseTracker(pose_models(), options).process(frame(0, true), state)),
      InputError);
  options.camera.reset();
  options.focal_px = 700;
  EXPECT_EQ(PoseTracker(pose_models(), options).process(frame(0, true), state).camera.fx, 700);
}

TEST(PoseTrackerLoadTest, ShippedViewModelNeedsTheShippedModels) {
  EXPECT_NE(pose_models().view, nullptr);
  PoseTrackerOptions options;
  options.head = models().path("head.json");  // a given file may be any model
  EXPECT_EQ(load_pose_models(models(), options).view, nullptr);
  options.view = models().path("head-view.json");
  EXPECT_NE(load_pose_models(models(), options).view, nullptr);
  options.refine = false;
  EXPECT_THROW(options.check(), std::invalid_argument);
  options.view.clear();
  EXPECT_EQ(load_pose_models(models(), options).view, nullptr);
}

TEST(PoseTrackerLoadTest, RejectsInconsistentModels) {
  const TemporaryFolder folder;
  PoseTrackerOptions options;
  options.mapping = folder / "few.txt";
  std::ofstream(options.mapping) << "0 0\n1 1\n2 2\n3 3\n4 4\n";
  try {
    static_cast<void>(load_pose_models(models(), options));
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_THAT(error.what(), HasSubstr("at least 6 points"));
  }
  options = {};
  options.head = folder / "missing.json";
  EXPECT_THROW(static_cast<void>(PoseTracker::load(models(), options)), ModelError);
  options = {};
  options.mean_length = 0;
  EXPECT_THROW(static_cast<void>(PoseTracker::load(models(), options)), std::invalid_argument);
  options = {};
  options.focal_px = -1;
  EXPECT_THROW(options.check(), std::invalid_argument);
  PoseModels wrong = pose_models();
  wrong.mapping.landmarks[0] = 500;
  EXPECT_THROW(PoseTracker(wrong, {}), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face
