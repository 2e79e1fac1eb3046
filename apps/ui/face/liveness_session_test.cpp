// SPDX-License-Identifier: MIT
#include "ui/face/liveness_session.h"

#include "tarsier/face/head/angles.h"
#include "tarsier/synth/face/synth_face.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

namespace tarsier {
namespace {

using face::head::LivenessState;
using face::head::LivenessTask;

// A seed whose first two tasks are turns.
std::uint64_t seed_of_turns() {
  for (std::uint64_t seed = 1;; ++seed) {
    const std::vector<LivenessTask> tasks = face::head::draw_tasks(2, seed);
    if (std::find(tasks.begin(), tasks.end(), LivenessTask::kBlink) == tasks.end()) return seed;
  }
}

// Drawn heads before the session, ten frames a second.
class LivenessSessionTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    const ModelStore store(TARSIER_SOURCE_MODELS);
    face::PoseTrackerOptions options;
    options.refine = false;
    models_ = std::make_unique<face::PoseModels>(face::load_pose_models(store, options));
    const std::string folder = TARSIER_SOURCE_MODELS;
    appearance_ = std::make_unique<face::appearance::AppearanceModel>(
        face::appearance::read_appearance_model(folder + "/aam68.json"));
    synth_ = std::make_unique<synth::FaceSynth>(*appearance_,
                                                face::head::read_head_model(folder + "/head.json"));
  }
  static void TearDownTestSuite() {
    synth_.reset();
    appearance_.reset();
    models_.reset();
  }
  void SetUp() override {
    options_.tasks = 2;
    options_.look_s = 0.3;
    options_.lost_s = 0.3;
    options_.task_s = 2;
  }
  LivenessSession session() const {
    return {face::PoseTracker(*models_, {}), seed_of_turns(), options_};
  }
  static cv::Mat head(double yaw_deg) {
    geometry::Camera camera;
    camera.width = 320;
    camera.height = 240;
    camera.fx = camera.fy = 400;
    camera.cx = 159.5;
    camera.cy = 119.5;
    cv::Mat image;
    (void)synth_->draw(image, {}, camera,
                       {face::head::rotation_of_angles({yaw_deg, 0, 0}), {0, 0, 600}}, {}, 1);
    return image;
  }
  View show_frame(LivenessSession& session, const cv::Mat& image) {
    Frame frame;
    frame.image = image;
    frame.index = index_;
    frame.time = 0.1 * index_++;
    frame.still = false;
    return session.on_frame(frame, {});
  }
  void wait_for_challenge(LivenessSession& session) {
    const cv::Mat image = head(0);
    for (int k = 0; k < 10 && session.challenge().state == LivenessState::kLook; ++k)
      (void)show_frame(session, image);
  }

  static std::unique_ptr<face::PoseModels> models_;
  static std::unique_ptr<face::appearance::AppearanceModel> appearance_;
  static std::unique_ptr<synth::FaceSynth> synth_;
  face::head::LivenessOptions options_;
  int index_ = 0;
};
std::unique_ptr<face::PoseModels> LivenessSessionTest::models_;
std::unique_ptr<face::appearance::AppearanceModel> LivenessSessionTest::appearance_;
std::unique_ptr<synth::FaceSynth> LivenessSessionTest::synth_;

TEST_F(LivenessSessionTest, PassesIfTheHeadTurnsAsRequested) {
  LivenessSession liveness_session = session();
  wait_for_challenge(liveness_session);
  double yaw = 0;
  View view;
  for (int k = 0; k < 60 && liveness_session.challenge().state == LivenessState::kAsk; ++k) {
    yaw += *liveness_session.challenge().task == LivenessTask::kTurnLeft ? -4 : 4;
    yaw = std::clamp(yaw, -28.0, 28.0);
    view = show_frame(liveness_session, head(yaw));
  }
  EXPECT_EQ(view.state["state"], "passed") << liveness_session.challenge_json();
  EXPECT_TRUE(view.state["task"].is_null());
  EXPECT_EQ(view.status.find("2 of 2: passed"), 0U) << view.status;
}

TEST_F(LivenessSessionTest, FailsIfTheHeadDoesNotMove) {
  LivenessSession liveness_session = session();
  wait_for_challenge(liveness_session);
  ASSERT_EQ(liveness_session.challenge().state, LivenessState::kAsk);
  const cv::Mat still = head(0);
  View view = show_frame(liveness_session, still);
  EXPECT_EQ(view.state["task"], std::string(name_of(*liveness_session.challenge().task)));
  EXPECT_GT(cv::norm(view.output, still, cv::NORM_INF), 50) << "the request is drawn";
  for (int k = 0; k < 25; ++k) view = show_frame(liveness_session, still);
  EXPECT_EQ(view.state["state"], "failed");
  EXPECT_EQ(view.state["reason"], "time");
  EXPECT_EQ(view.status.find("0 of 2: not passed: time"), 0U) << view.status;
}

TEST_F(LivenessSessionTest, FailsWithoutAFaceAndCanBeRestarted) {
  LivenessSession liveness_session = session();
  wait_for_challenge(liveness_session);
  const cv::Mat nobody(240, 320, CV_8UC3, cv::Scalar::all(90));
  for (int k = 0; k < 10; ++k) (void)show_frame(liveness_session, nobody);
  EXPECT_EQ(liveness_session.challenge().state, LivenessState::kFailed);
  EXPECT_EQ(liveness_session.challenge_json()["reason"], "no face");

  EXPECT_EQ(liveness_session.on_event(key_event('n')).state["state"], "look");
  wait_for_challenge(liveness_session);
  EXPECT_EQ(liveness_session.challenge().state, LivenessState::kAsk);
  EXPECT_TRUE(liveness_session.on_event(key_event('q')).finished);
}

}  // namespace
}  // namespace tarsier
