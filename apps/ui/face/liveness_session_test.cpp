// SPDX-License-Identifier: MIT
#include "ui/face/liveness_session.h"

#include "tarsier/media/image_file.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <filesystem>
#include <string>
#include <vector>

namespace tarsier {
namespace {

using face::head::LivenessState;

constexpr const char* kMessi = "/usr/share/doc/opencv-doc/examples/data/messi5.jpg";

class LivenessSessionTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(kMessi)) GTEST_SKIP() << "needs the package opencv-doc";
    image_ = read_image(kMessi);
  }
  static LivenessSession session(const face::head::LivenessOptions& options = {}) {
    static const face::PoseModels models = [] {
      face::PoseTrackerOptions tracker;
      tracker.refine = false;
      return face::load_pose_models(ModelStore(TARSIER_SOURCE_MODELS), tracker);
    }();
    return {face::PoseTracker(models, {}), 3, options};
  }
  // Ten frames a second.
  View see(LivenessSession& session, const cv::Mat& image) {
    Frame frame;
    frame.image = image;
    frame.index = index_;
    frame.time = 0.1 * index_++;
    return session.on_frame(frame, {});
  }
  cv::Mat image_;
  int index_ = 0;
};

TEST_F(LivenessSessionTest, AStillImageIsAskedAndDoesNotPass) {
  face::head::LivenessOptions options;
  options.look_s = 0.3;
  options.task_s = 1;
  LivenessSession asked = session(options);
  EXPECT_EQ(see(asked, image_).state["state"], "look");
  std::vector<std::string> states;
  View view;
  for (int k = 0; k < 25 && asked.challenge().state != LivenessState::kFailed; ++k) {
    view = see(asked, image_);
    const std::string state = view.state["state"];
    if (states.empty() || states.back() != state) states.push_back(state);
    if (state == "ask") {
      EXPECT_TRUE(view.state["task"].is_string());
    }
  }
  EXPECT_EQ(states, (std::vector<std::string>{"look", "ask", "failed"}));
  EXPECT_EQ(view.state["reason"], "time");
  EXPECT_EQ(view.state["done"], 0);
  EXPECT_EQ(view.state["tasks"], options.tasks);
  EXPECT_NE(view.status.find("not passed: time"), std::string::npos) << view.status;
  EXPECT_GT(cv::norm(view.output, image_, cv::NORM_INF), 50) << "the request is drawn";
}

TEST_F(LivenessSessionTest, AFaceThatGoesFailsAndAgainBeginsAnew) {
  face::head::LivenessOptions options;
  options.look_s = 0.3;
  options.lost_s = 0.3;
  LivenessSession asked = session(options);
  for (int k = 0; k < 8; ++k) (void)see(asked, image_);
  EXPECT_EQ(asked.challenge().state, LivenessState::kAsk);
  const cv::Mat nobody(image_.size(), image_.type(), cv::Scalar::all(90));
  for (int k = 0; k < 8; ++k) (void)see(asked, nobody);
  EXPECT_EQ(asked.challenge().state, LivenessState::kFailed);
  EXPECT_EQ(asked.challenge_json()["reason"], "no face");

  EXPECT_EQ(asked.on_event(key_event('n')).state["state"], "look");
  for (int k = 0; k < 8; ++k) (void)see(asked, image_);
  EXPECT_EQ(asked.challenge().state, LivenessState::kAsk);
  EXPECT_TRUE(asked.on_event(key_event('q')).finished);
}

TEST_F(LivenessSessionTest, OnlyTheLargestFaceIsAsked) {
  // The same face twice, the second half as large.
  cv::Mat small;
  cv::resize(image_, small, {}, 0.5, 0.5, cv::INTER_AREA);
  cv::Mat both(image_.rows, image_.cols + small.cols, CV_8UC3, cv::Scalar::all(90));
  image_.copyTo(both(cv::Rect({}, image_.size())));
  small.copyTo(both(cv::Rect({image_.cols, 0}, small.size())));
  face::head::LivenessOptions options;
  options.look_s = 0.3;
  options.lost_s = 0.3;
  LivenessSession asked = session(options);
  for (int k = 0; k < 8; ++k) (void)see(asked, both);
  ASSERT_EQ(asked.challenge().state, LivenessState::kAsk);
  // It goes; the small one alone does not answer in its place.
  both(cv::Rect({}, image_.size())).setTo(cv::Scalar::all(90));
  for (int k = 0; k < 8; ++k) (void)see(asked, both);
  EXPECT_EQ(asked.challenge().state, LivenessState::kFailed);
}

}  // namespace
}  // namespace tarsier
