// SPDX-License-Identifier: MIT
#include "ui/face/landmark_show_session.h"

#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "ui/testing_plain.h"
#include <cmath>
#include <string>
#include <utility>

namespace tarsier {
namespace {

class LandmarkSetSessionTest : public ::testing::Test {
 protected:
  void SetUp() override {
    for (int k = 0; k < 2; ++k) {
      cv::Mat image(120, 200, CV_8UC3, cv::Scalar(60, 60, 60));
      cv::rectangle(image, {0, 0, 20, 120}, cv::Scalar(0, 0, 200), cv::FILLED);
      write_image(folder_ / (std::to_string(k) + ".png"), image);
      face::shape::LandmarkSample sample;
      sample.image = std::to_string(k) + ".png";
      sample.points.resize(2, 3);
      sample.points << 50, 90, 70, 40, 40, 80;
      set_.samples.push_back(sample);
    }
    set_.samples[1].points.col(2).setConstant(std::nan(""));
    set_.samples.push_back(set_.samples[0]);
    set_.samples[2].image = "gone.png";
    set_.mirror = {1, 0, 2};
  }
  LandmarkSetSession session() { return {set_, folder_ / "set.yaml", {}, false}; }

  TemporaryFolder folder_;
  face::shape::LandmarkSet set_;
};

TEST_F(LandmarkSetSessionTest, CyclesThroughAllImages) {
  LandmarkSetSession session = this->session();
  EXPECT_EQ(session.on_event(key_event('n')).state.at("image"), 1);
  EXPECT_EQ(session.on_event(key_event(key::kRight)).state.at("image"), 2);
  EXPECT_EQ(session.on_event(key_event(key::kSpace)).state.at("image"), 0);
  View view = session.on_event(key_event(key::kLeft));
  EXPECT_EQ(view.state.at("path"), "gone.png") << "an image that is gone is passed, too";
  view = session.on_event(key_event('p'));
  EXPECT_EQ(view.state.at("missing"), 1);
  EXPECT_TRUE(session.on_event(key_event('q')).finished);
}

TEST_F(LandmarkSetSessionTest, MirroredImageAndPointsAgree) {
  LandmarkSetSession session = this->session();
  const cv::Mat plain = session.on_idle({}).image.clone();
  const cv::Mat turned = session.on_event(key_event('m')).image.clone();
  // The red edge is at the other side, and where points were drawn they are drawn mirrored.
  EXPECT_GT(plain.at<cv::Vec3b>(30, 5)[2], 150);
  EXPECT_GT(turned.at<cv::Vec3b>(30, turned.cols - 6)[2], 150);
  const cv::Rect upper(0, 0, plain.cols, plain.rows * 3 / 4);
  cv::Mat back;
  cv::flip(turned, back, 1);
  cv::Mat difference;
  cv::absdiff(plain(upper), back(upper), difference);
  EXPECT_LT(cv::mean(difference)[0], 3);
}

TEST_F(LandmarkSetSessionTest, EachSwitchChangesTheImage) {
  set_.connections = {{0, 1}};
  LandmarkSetSession session = this->session();
  for (const char key : std::string("iylm?")) {
    const cv::Mat before = session.on_idle({}).image.clone();
    const cv::Mat after = session.on_event(key_event(key)).image.clone();
    EXPECT_GT(cv::norm(before, after, cv::NORM_INF), 20) << key;
    const cv::Mat again = session.on_event(key_event(key)).image;
    EXPECT_EQ(cv::norm(before, again, cv::NORM_INF), 0) << key;
  }
}

TEST(ShapeModelSession, SlidersAndAnimationMoveTheModes) {
  face::shape::LandmarkSet set;
  for (int k = 0; k < 12; ++k) {
    face::shape::LandmarkSample sample;
    sample.image = "x";
    sample.points.resize(2, 5);
    sample.points << -10, 10, 10, -10, 3.0 * std::sin(k), -10, -10, 10, 10 + std::cos(2.0 * k),
        2.0 * std::cos(k);
    set.samples.push_back(sample);
  }
  ShapeModelSession session(face::shape::train_shape_model(set));
  ASSERT_GE(session.sliders().size(), 2u);
  const cv::Mat before = session.on_event(action_event("mean")).image.clone();
  EXPECT_FALSE(session.on_idle({}).state.at("animated"));
  test_support::expect_plain_image(session);
  session.draw_status(true);
  const View view = session.on_event(slider_event("mode 2", 2.5));
  EXPECT_EQ(view.state.at("values")[1], 2.5);
  EXPECT_GT(cv::norm(before, view.image, cv::NORM_INF), 20);
  EXPECT_EQ(session.sliders()[1].value, 2.5);
  EXPECT_EQ(session.on_event(slider_event("mode 2", 99)).state.at("values")[1], 3.0);
  EXPECT_EQ(session.on_event(slider_event("mode 99", 1)).state.at("values")[1], 3.0);
  session.on_event(key_event(key::kSpace));
  const auto first = session.on_idle({}).state;
  const auto second = session.on_idle({}).state;
  EXPECT_NE(first.at("values"), second.at("values"));
}

TEST_F(LandmarkSetSessionTest, WithoutStatusDrawsNoBar) {
  LandmarkSetSession session = this->session();
  test_support::expect_plain_image(session);
}

}  // namespace
}  // namespace tarsier
