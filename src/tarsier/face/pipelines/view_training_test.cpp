// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/view_training.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/head/angles.h"
#include "tarsier/face/head/evaluation.h"
#include "tarsier/face/pipelines/testing_messi.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>
#include <string>

namespace tarsier::face {
namespace {

PoseTrackerOptions landmarks_alone() {
  PoseTrackerOptions options;
  options.refine = false;
  return options;
}

const PoseModels& landmark_pose_models() {
  static const PoseModels shared = load_pose_models(models(), landmarks_alone());
  return shared;
}

// Constant difference between the ground truth and the pose of the landmarks.
constexpr double kPitchBias_deg = 6;  // degrees of pitch

class ViewTrainingTest : public MessiTest {
 protected:
  // Draws `count` views of a head, each with its own rotation, scale and mirroring.
  void draw_heads(int count) {
    make_folder(folder_.path() + "/images");
    const PoseTracker tracker(landmark_pose_models(), landmarks_alone());
    PoseState state;
    std::ofstream file(truth());
    for (int i = 0; i < count; ++i) {
      const cv::Point2f middle(0.5F * static_cast<float>(image_.cols),
                               0.5F * static_cast<float>(image_.rows));
      const cv::Mat turn = cv::getRotationMatrix2D(middle, 3.0 * (i % 5) - 6, 1 + 0.04 * (i % 3));
      Frame frame;
      cv::warpAffine(image_, frame.image, turn, image_.size(), cv::INTER_LINEAR,
                     cv::BORDER_REPLICATE);
      if (i % 2 == 1) cv::flip(frame.image, frame.image, 1);
      frame.still = true;
      frame.name = std::to_string(i);
      const std::string name = "images/" + frame.name + ".png";
      write_image(folder_.path() + "/" + name, frame.image);
      const PoseResult result = tracker.process(frame, state);
      const Eigen::Matrix3d truth = result.faces.at(0).pose.value().camera_from_head.rotation *
                                    head::rotation_of_angles({0, kPitchBias_deg, 0});
      nlohmann::json line{{"image", name}};
      for (int k = 0; k < 9; ++k) line["rotation"].push_back(truth(k / 3, k % 3));
      file << line << '\n';
    }
  }
  [[nodiscard]] std::string truth() const { return folder_.path() + "/truth.jsonl"; }

  TemporaryFolder folder_;
  NoProgress progress_;
};

TEST_F(ViewTrainingTest, RejectsRefinementAndGivenCameras) {
  EXPECT_THROW(ViewTraining(landmark_pose_models(), {}), std::invalid_argument);
  PoseTrackerOptions options = landmarks_alone();
  options.camera = geometry::Camera();
  EXPECT_THROW(ViewTraining(landmark_pose_models(), options), std::invalid_argument);
}

TEST_F(ViewTrainingTest, ScoresHeldOutGroups) {
  constexpr int kHeads = 16;
  draw_heads(kHeads);
  ViewTraining training(landmark_pose_models(), landmarks_alone());
  EXPECT_TRUE(training.samples().empty());
  training.add_truth(truth(), progress_, {});
  ASSERT_EQ(training.samples().size(), static_cast<std::size_t>(kHeads));
  EXPECT_EQ(training.sources(), std::vector<std::string>{truth()});
  std::set<int> groups;
  for (const head_view::ViewSample& sample : training.samples()) {
    groups.insert(sample.group);
    EXPECT_FALSE(sample.nominal);
  }
  EXPECT_EQ(groups.size(), 7U) << "sevenths are left out in turn";

  const ViewTraining::Scores alone = training.score_landmarks();
  EXPECT_FALSE(alone.pointing);
  ASSERT_TRUE(alone.exact);
  EXPECT_EQ(alone.exact->truths, kHeads);
  EXPECT_NEAR(alone.exact->mean_deg, kPitchBias_deg, 1e-3);
  EXPECT_EQ(alone.exact->coverage.yaw.count, kHeads);
  const ViewTraining::Scores refined = training.score_held_out({});
  ASSERT_TRUE(refined.exact);
  EXPECT_LT(refined.exact->mean_deg, 0.6 * kPitchBias_deg) << "the slip is learnt";
  // The score of the landmarks alone stays the same.
  EXPECT_EQ(training.score_landmarks().exact->mean_deg, alone.exact->mean_deg);
}

TEST_F(ViewTrainingTest, PointingTruthIsTheNominalDirection) {
  write_image(folder_.path() + "/person03100-15-30.png", image_);
  write_image(folder_.path() + "/person04100+0+0.png",
              cv::Mat(240, 320, CV_8UC3, cv::Scalar(90, 90, 90)));
  ViewTraining training(landmark_pose_models(), landmarks_alone());
  training.add_pointing(folder_.path(), 0.9, progress_, {});
  ASSERT_EQ(training.samples().size(), 1U) << "the other one shows no head";
  EXPECT_EQ(training.samples()[0].group, 3);
  EXPECT_TRUE(training.samples()[0].nominal);
  // Directions are in the camera's frame, although the head is not in the middle of the image.
  const head_view::HeadView& view = training.samples()[0].view;
  EXPECT_GT((view.camera_from_view - Eigen::Matrix3d::Identity()).norm(), 0.02);
  const Eigen::Vector3d forward =
      head_view::rotation_towards(view, training.samples()[0].truth) * Eigen::Vector3d(0, 0, -1);
  EXPECT_LT((forward - head::forward_of_gaze({-30, -15 * 0.9})).norm(), 1e-9);
  const ViewTraining::Scores scores = training.score_landmarks();
  EXPECT_FALSE(scores.exact);
  ASSERT_TRUE(scores.pointing);
  EXPECT_EQ(scores.pointing->images, 2);
  EXPECT_EQ(scores.pointing->with_pose, 1);
}

TEST_F(ViewTrainingTest, AnnotatedFacesNeedThePointsOfTheLandmarkModel) {
  ViewTraining training(landmark_pose_models(), landmarks_alone());
  shape::LandmarkSet set;
  set.samples.emplace_back().image = kMessi;
  set.samples.back().points = Eigen::Matrix2Xd::Zero(2, 5);
  EXPECT_THROW(training.add_annotated(set, "set.json", progress_, {}), InputError);

  PoseState state;
  const PoseResult result =
      PoseTracker(landmark_pose_models(), landmarks_alone()).process(frame(0, true), state);
  set.samples.back().points = result.faces.at(0).face.points;
  training.add_annotated(set, "set.json", progress_, {});
  ASSERT_EQ(training.samples().size(), 1U);
  const ViewTraining::Scores scores = training.score_landmarks();
  ASSERT_TRUE(scores.exact);
  EXPECT_LT(scores.exact->mean_deg, 3) << "the truth is the pose of the same points";
}

}  // namespace
}  // namespace tarsier::face
