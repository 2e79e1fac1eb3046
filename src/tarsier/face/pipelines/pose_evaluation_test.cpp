// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/pose_evaluation.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/pipelines/testing_messi.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

namespace tarsier::face {
namespace {

using testing::HasSubstr;

class PoseEvaluationFiles : public testing::Test {
 protected:
  void write(const std::string& name) {
    write_image(folder_.path() + "/" + name, cv::Mat(8, 8, CV_8UC3, cv::Scalar(9, 9, 9)));
  }
  TemporaryFolder folder_;
};

TEST_F(PoseEvaluationFiles, PointingImagesAreSelectedByTheirAngles) {
  EXPECT_THROW((void)pointing_images(folder_.path() + "/none"), InputError);
  EXPECT_THROW((void)pointing_images(folder_.path()), InputError);
  make_folder(folder_.path() + "/Person02");
  write("Person02/person02100+30-45.png");
  write("person01101-60+0.png");
  write("person01102+0+90.png");
  write("portrait.png");
  const auto scored = pointing_images(folder_.path());
  ASSERT_EQ(scored.size(), 1U);
  EXPECT_EQ(scored[0].name.person, 2);
  EXPECT_EQ(scored[0].name.tilt_deg, 30);
  EXPECT_EQ(scored[0].name.pan_deg, -45);
  const auto all = pointing_images(folder_.path(), 90, 60);
  ASSERT_EQ(all.size(), 3U);
  EXPECT_THAT(all[1].path, HasSubstr("person01101-60+0"));
  EXPECT_THAT(all[2].path, HasSubstr("person01102+0+90"));
}

TEST_F(PoseEvaluationFiles, ResolvesPathsRelativeToTheFile) {
  EXPECT_EQ(resolve_image_path(folder_.path() + "/truth.jsonl", "a/1.png"),
            folder_.path() + "/a/1.png");
  write("2.png");
  EXPECT_EQ(resolve_image_path("/elsewhere/truth.jsonl", folder_.path() + "/2.png"),
            folder_.path() + "/2.png");
}

TEST_F(PoseEvaluationFiles, FaceInHeadBoxHasItsCentreInTheBox) {
  const std::string image = folder_.path() + "/person01100+0+0.jpg";
  std::ofstream(folder_.path() + "/person01100+0+0.txt") << "Face\n100\n100\n40\n60\n";
  std::vector<PosedFace> faces(3);
  faces[0].face.box = {0, 0, 40, 40};
  faces[0].pose = head::HeadPose();
  faces[1].face.box = {90, 90, 20, 20};  // in the box, without a pose
  faces[2].face.box = {60, 80, 60, 60};
  faces[2].pose = head::HeadPose();
  EXPECT_EQ(face_in_head_box(faces, image, {200, 200}), &faces[2]);
  EXPECT_EQ(face_in_head_box(faces, folder_.path() + "/other.jpg", {200, 200}), &faces[0]);
  EXPECT_EQ(face_in_head_box({}, image, {200, 200}), nullptr);
}

TEST(AngleSigmas, ReturnsYawPitchAndRoll) {
  head::HeadPose pose;
  pose.yaw_sigma_deg = 1;
  pose.pitch_sigma_deg = 2;
  pose.roll_sigma_deg = 3;
  EXPECT_EQ(angle_sigmas(pose), Eigen::Vector3d(1, 2, 3));
}

class PoseEvaluation : public MessiTest {
 protected:
  TemporaryFolder folder_;
  NoProgress progress_;
};

TEST_F(PoseEvaluation, PosesEqualThoseOfTheTracker) {
  const PoseTrackerOptions options;
  const PoseModels read = load_pose_models(models(), options);
  PoseEvaluator evaluator(read, options);
  write_image(folder_.path() + "/empty.png", cv::Mat(240, 320, CV_8UC3, cv::Scalar(90, 90, 90)));
  const std::string path = folder_.path() + "/truth.jsonl";
  const std::vector<head::PoseLine> truth{{kMessi, {}, {}, {}, {}}, {"empty.png", {}, {}, {}, {}}};
  const auto found = evaluator.poses(path, truth, {}, progress_, {});

  PoseState state;
  const PoseResult expected = PoseTracker(read, options).process(frame(0, true), state);
  const head::HeadPose& pose = expected.faces.at(0).pose.value();
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].image, kMessi);
  EXPECT_EQ(found[0].rotation, pose.camera_from_head.rotation);
  EXPECT_EQ(found[0].translation, pose.camera_from_head.translation);
  EXPECT_EQ(found[0].sigma_deg, angle_sigmas(pose));
  EXPECT_EQ(found[0].sigma_floor_deg, pose.sigma_floor_deg);
  EXPECT_EQ(found[1].image, "empty.png");
  EXPECT_FALSE(found[1].rotation);

  std::istringstream lines(evaluator.lines());
  std::string line;
  ASSERT_TRUE(std::getline(lines, line));
  EXPECT_EQ(nlohmann::ordered_json::parse(line)["faces"], to_json(expected)["faces"]);
  ASSERT_TRUE(std::getline(lines, line));
  EXPECT_EQ(nlohmann::ordered_json::parse(line)["image"], "empty.png");
  EXPECT_FALSE(std::getline(lines, line));
}

TEST_F(PoseEvaluation, OcclusionDependsOnTheSeed) {
  const PoseModels read = load_pose_models(models());
  const auto rotation = [&](std::uint64_t seed) {
    PoseEvaluator evaluator(read, {});
    const auto found =
        evaluator.poses("truth.jsonl", {{kMessi, {}, {}, {}, {}}}, {true, seed}, progress_, {});
    return found.at(0).rotation.value_or(Eigen::Matrix3d::Zero());
  };
  const Eigen::Matrix3d first = rotation(1);
  EXPECT_EQ(rotation(1), first);
  PoseEvaluator evaluator(read, {});
  const auto plain = evaluator.poses("truth.jsonl", {{kMessi, {}, {}, {}, {}}}, {}, progress_, {});
  EXPECT_NE(plain.at(0).rotation.value(), first);
}

TEST_F(PoseEvaluation, PointingEvaluatesTheAnnotatedHead) {
  const std::string path = folder_.path() + "/person01100-15-30.png";
  write_image(path, image_);
  PoseEvaluator evaluator(load_pose_models(models()), {});
  const auto images = pointing_images(folder_.path());
  const auto outcomes = evaluator.pointing(images, progress_, {});
  ASSERT_EQ(outcomes.size(), 1U);
  EXPECT_EQ(outcomes[0].truth.pan_deg, -30);
  EXPECT_TRUE(outcomes[0].rotation);
  EXPECT_TRUE(outcomes[0].sigma_deg);
  EXPECT_TRUE(outcomes[0].face_detected);
  // The annotated place is another one, so his face does not count.
  std::ofstream(folder_.path() + "/person01100-15-30.txt") << "Face\n20\n300\n20\n20\n";
  const auto elsewhere = evaluator.pointing(images, progress_, {});
  EXPECT_FALSE(elsewhere.at(0).rotation);
  EXPECT_FALSE(elsewhere.at(0).face_detected);
}

TEST_F(PoseEvaluation, CanBeInterrupted) {
  std::stop_source stop;
  stop.request_stop();
  PoseEvaluator evaluator(load_pose_models(models()), {});
  EXPECT_THROW((void)evaluator.poses("truth.jsonl", {{kMessi, {}, {}, {}, {}}}, {}, progress_,
                                     stop.get_token()),
               Interrupted);
}

}  // namespace
}  // namespace tarsier::face
