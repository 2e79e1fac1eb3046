// SPDX-License-Identifier: MIT
#include "tarsier/synth/face/synth_face.h"

#include "tarsier/face/head/angles.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <string>

namespace tarsier::synth {
namespace {

const std::string kModels = TARSIER_SOURCE_MODELS;

class SynthFaceTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    model_ = std::make_unique<face::appearance::AppearanceModel>(
        face::appearance::read_appearance_model(kModels + "/aam68.json"));
    synth_ =
        std::make_unique<FaceSynth>(*model_, face::head::read_head_model(kModels + "/head.json"));
  }
  static void TearDownTestSuite() {
    synth_.reset();
    model_.reset();
  }
  static geometry::Camera camera() {
    geometry::Camera camera;
    camera.width = 320;
    camera.height = 240;
    camera.fx = camera.fy = 400;
    camera.cx = 159.5;
    camera.cy = 119.5;
    return camera;
  }
  static geometry::Rigid3 pose(double yaw, double pitch = 0, double roll = 0) {
    return {face::head::rotation_of_angles({yaw, pitch, roll}), {10, -20, 600}};
  }

  static std::unique_ptr<face::appearance::AppearanceModel> model_;
  static std::unique_ptr<FaceSynth> synth_;
};
std::unique_ptr<face::appearance::AppearanceModel> SynthFaceTest::model_;
std::unique_ptr<FaceSynth> SynthFaceTest::synth_;

TEST_F(SynthFaceTest, TruthIsProjectionOfHeadPoints) {
  FacePerson mean;
  mean.b = Eigen::VectorXd::Zero(synth_->head().mode_count());
  cv::Mat image;
  const FaceTruth truth = synth_->draw(image, mean, camera(), pose(20, 5), {}, 1);
  const Eigen::Vector3d nose = synth_->head().mean.col(30);
  const Eigen::Vector3d at = pose(20, 5) * Eigen::Vector3d(nose.x(), nose.y(), nose.z());
  EXPECT_NEAR(truth.points(0, 30), 159.5 + 400 * at[0] / at[2], 1e-9);
  EXPECT_NEAR(truth.points(1, 30), 119.5 + 400 * at[1] / at[2], 1e-9);
  // If the head is turned to image left, the nose is nearer to the eye corner on that side.
  EXPECT_LT(truth.points(0, 30) - truth.points(0, 36), truth.points(0, 45) - truth.points(0, 30));
}

// The brightness agrees with the ground truth: the eyes are dark at the eye landmarks.
TEST_F(SynthFaceTest, EyesAreDarkerThanTheCheeksBelowThem) {
  FaceSceneOptions plain;
  plain.noise = 0;
  plain.diffuse = 0;
  plain.ambient = 1;
  for (const double yaw : {-15.0, 0.0, 15.0}) {
    cv::Mat image;
    const FaceTruth truth = synth_->draw(image, {}, camera(), pose(yaw), plain, 1);
    cv::Mat gray;
    cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
    const auto mean_at = [&](const Eigen::Vector2d& p, int radius) {
      const cv::Rect box(cvRound(p.x()) - radius, cvRound(p.y()) - radius, 2 * radius + 1,
                         2 * radius + 1);
      return cv::mean(gray(box))[0];
    };
    for (const auto& [first, last, cheek] : {std::array{36, 41, 31}, std::array{42, 47, 35}}) {
      Eigen::Vector2d eye(0, 0);
      for (int i = first; i <= last; ++i) eye += truth.points.col(i) / (last - first + 1);
      const Eigen::Vector2d below(eye.x(), truth.points(1, cheek));
      EXPECT_LT(mean_at(eye, 2) + 10, mean_at(below, 2)) << "yaw " << yaw;
    }
  }
}

TEST_F(SynthFaceTest, DependsOnSeedNotThreads) {
  const FacePerson person = synth_->person(7);
  cv::Mat first;
  cv::Mat second;
  cv::Mat other;
  synth_->draw(first, person, camera(), pose(10), {}, 3);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  synth_->draw(second, synth_->person(7), camera(), pose(10), {}, 3);
  cv::setNumThreads(threads);
  EXPECT_EQ(cv::norm(first, second, cv::NORM_INF), 0);
  synth_->draw(other, synth_->person(8), camera(), pose(10), {}, 3);
  EXPECT_GT(cv::norm(first, other, cv::NORM_L1) / static_cast<double>(first.total()), 1);
}

TEST_F(SynthFaceTest, KeepsGivenBackground) {
  FaceSceneOptions options;
  options.with_background = false;
  options.noise = 0;
  options.blur_px = 0;
  cv::Mat image(240, 320, CV_8UC3, cv::Scalar(1, 2, 3));
  synth_->draw(image, {}, camera(), pose(0), options, 1);
  EXPECT_EQ(image.at<cv::Vec3b>(2, 2), cv::Vec3b(1, 2, 3));
  EXPECT_NE(image.at<cv::Vec3b>(110, 165), cv::Vec3b(1, 2, 3));
  cv::Mat wrong(100, 100, CV_8UC3);
  EXPECT_THROW(synth_->draw(wrong, {}, camera(), pose(0), options, 1), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::synth
