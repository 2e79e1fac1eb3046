// SPDX-License-Identifier: MIT
#include "ui/planar/calibrate_session.h"

#include "tarsier/core/testing_long.h"
#include "tarsier/synth/boards.h"
#include "tarsier/synth/sources.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "ui/scripted_host.h"
#include "ui/testing_keep.h"
#include "ui/testing_plain.h"
#include <nlohmann/json.hpp>
#include <string>

namespace tarsier {
namespace {

using planar::calibration::parse_board;
using ::testing::Contains;

planar::Calibrator calibrator() {
  planar::CalibratorOptions options = planar::live_calibrator_options();
  options.board = parse_board("chess:9x6", 0.025);
  return planar::Calibrator::load(options);
}

// 0.5 s without a board, then places of 0.6 s with 0.6 s between them; 10 frames a second.
std::unique_ptr<FrameSource> video(int frames) {
  return synth::open_synth_source("board?size=480x360&fps=10&frames=" + std::to_string(frames));
}

TEST(CalibrateSessionTest, AcceptsViewsAndCalibratesByItself) {
  TARSIER_LONG_TEST();
  CalibrateSession session(calibrator());
  const auto source = video(124);
  ScriptedHost host(session, *source);
  host.schedule(114, action_event("straight"));
  host.schedule(119, key_event('h'));
  for (const int frame : {2, 12, 20, 100, 113, 116, 120}) host.keep_images(frame);
  const auto& steps = host.run();
  for (const ScriptStep& step : steps)
    if (!step.image.empty())
      test_support::keep_image(step.image, "session-" + std::to_string(step.frame));
  // Nothing without a board, nothing while it moves.
  EXPECT_EQ(steps[2].state["verdict"], "no board");
  EXPECT_EQ(steps[2].state["views"], 0);
  int taken_moving = 0;
  const synth::BoardVideo truth({480, 360}, calibrator().options().board, 1);
  for (const planar::CalibrationImage& view : session.calibrator_state().images) {
    const auto now = truth.pose_at(view.time);
    const auto before = truth.pose_at(view.time - 0.1);
    ASSERT_TRUE(now && before);
    if ((now->translation - before->translation).norm() > 0.004) ++taken_moving;
  }
  EXPECT_EQ(taken_moving, 0);
  EXPECT_GE(session.calibrator_state().images.size(), 8U);
  ASSERT_TRUE(session.result());
  ASSERT_TRUE(session.result()->ok()) << session.result()->calibration.refusal;
  EXPECT_NEAR(session.result()->calibration.camera.fx / truth.camera().fx, 1, 2e-3);
  EXPECT_LT(session.result()->calibration.camera.rms, 0.1);
  EXPECT_EQ(steps.back().state["calibrated"], true);
  EXPECT_GT(steps.back().state["coverage"].get<double>(), 0.5);
  const nlohmann::json& views = steps.back().state["per_view"];
  ASSERT_EQ(views.size(), steps.back().state["views"]);
  EXPECT_EQ(views[0]["points"], 54);
  EXPECT_GT(views[0]["rms"], 0);
  EXPECT_LT(views[0]["rms"], 0.3);
  EXPECT_GT(views[0]["tilt"], 0);
  const nlohmann::json& cells = steps.back().state["cells"];
  ASSERT_EQ(cells.size(), 6U);
  int covered = 0;
  for (const nlohmann::json& row : cells) {
    ASSERT_EQ(row.size(), 8U);
    for (const int count : row) covered += count > 0 ? 1 : 0;
  }
  EXPECT_NEAR(covered / 48.0, steps.back().state["coverage"].get<double>(), 1e-3);
  // The undistorted image, then the help over it.
  for (const ScriptStep& step : steps)
    if (step.frame == 116 && step.cause == "frame") {
      EXPECT_EQ(step.state["straight"], true);
      EXPECT_GT(cv::norm(step.output, truth.image_at(11.6), cv::NORM_INF), 60);
    }
}

TEST(CalibrateSessionTest, ReportsMissingViewsAndDropsViews) {
  CalibrateSession session(calibrator());
  const auto source = video(60);
  ScriptedHost host(session, *source);
  host.schedule(40, key_event('z'));
  host.schedule(45, key_event('x'));
  const auto& steps = host.run();
  std::size_t before = 0;
  for (const ScriptStep& step : steps) {
    if (step.frame == 39 && step.cause == "frame") {
      before = step.state["views"].get<std::size_t>();
      EXPECT_FALSE(step.state["missing"].empty());
    }
    if (step.cause == "key z") {
      EXPECT_EQ(step.state["views"].get<std::size_t>(), before - 1);
    }
    if (step.cause == "key x") {
      EXPECT_EQ(step.state["views"], 0);
      EXPECT_EQ(step.state["calibrated"], false);
      EXPECT_EQ(step.state["coverage"], 0);
    }
  }
  EXPECT_GE(before, 2U);
  EXPECT_GE(session.calibrator_state().images.size(), 1U);  // it goes on
}

TEST(CalibrateSessionTest, AcceptsManualViewsAndReportsTheRefusal) {
  CalibrateSession session(calibrator());
  const auto source = video(9);
  ScriptedHost host(session, *source);
  host.schedule(1, key_event(key::kSpace));  // no board yet
  for (const int frame : {7, 8, 9}) host.schedule(frame, key_event(key::kSpace));
  host.schedule(9, action_event("calibrate"));
  host.schedule(9, action_event("straight"));
  host.schedule(9, key_event('q'));
  const auto& steps = host.run();
  EXPECT_EQ(steps[1].cause, "key 32");
  EXPECT_EQ(steps[1].state["views"], 0);
  const ScriptStep& last = steps.back();
  EXPECT_GE(last.state["views"].get<int>(), 3);
  EXPECT_EQ(last.state["calibrated"], false);
  EXPECT_NE(last.state["refusal"].get<std::string>().find("different views"), std::string::npos)
      << last.state["refusal"];
  EXPECT_EQ(last.state["straight"], false);
  EXPECT_TRUE(last.finished);
}

TEST(CalibrateSessionTest, AcceptsEachStillImage) {
  CalibrateSession session(calibrator());
  const synth::BoardVideo truth({480, 360}, calibrator().options().board, 1);
  for (int k = 0; k < 5; ++k) {
    Frame frame;
    frame.image = truth.image_at(0.6 + 1.2 * k);
    frame.index = k;
    frame.name = "image";
    frame.still = true;
    const View view = session.on_frame(frame, {});
    EXPECT_EQ(view.state["verdict"], "taken") << k;
  }
  Frame other;
  other.image = cv::Mat(100, 100, CV_8UC3, cv::Scalar::all(90));
  other.still = true;
  EXPECT_EQ(session.on_frame(other, {}).state["verdict"], "another size");
  EXPECT_EQ(session.calibrator_state().images.size(), 5U);
}

// A board that is only found as if it were evenly lit: after some frames it is, and stays so.
TEST(CalibrateSessionTest, FindsABoardInUnevenLight) {
  const geometry::Camera camera{480, 360, 408, 408, 240, 180};
  const auto spec = calibrator().options().board;
  synth::BoardAppearance appearance;
  appearance.fall_off = 0.8;
  const cv::Mat image = synth::render_board(
      camera, synth::board_pose(camera, spec, {0.5, 0.5}, {20, -15, 5}, 0.8), spec, appearance);
  CalibrateSession session(calibrator());
  int seen = 0;
  for (int k = 0; k < 12; ++k) {
    Frame frame;
    frame.image = image;
    frame.index = k;
    frame.time = 0.1 * k;
    frame.name = "video";
    if (session.on_frame(frame, {}).state["verdict"] != "no board") ++seen;
  }
  EXPECT_GE(seen, 9);
  EXPECT_EQ(session.calibrator_state().images.size(), 1U);
}

TEST(CalibrateSessionTest, IsDeterministic) {
  std::string first;
  for (int run = 0; run < 2; ++run) {
    CalibrateSession session(calibrator());
    const auto source = video(30);
    ScriptedHost host(session, *source);
    (void)host.run();
    if (run == 0) first = host.transcript();
    EXPECT_EQ(host.transcript(), first);
  }
}

TEST(CalibrateSessionTest, WithoutStatusDrawsNoText) {
  CalibrateSession session(calibrator());
  session.draw_status(false);
  Frame frame;
  frame.image = cv::Mat(360, 480, CV_8UC3, cv::Scalar(90, 90, 90));
  const View view = session.on_frame(frame, {SourceState::kLive, "", 0, 0, 0, 0});
  EXPECT_EQ(view.state["verdict"], "no board");
  EXPECT_EQ(cv::norm(view.image, view.output, cv::NORM_INF), 0);
  test_support::expect_plain_image(session, {SourceState::kLive, "", 0, 0, 0, 0});
}

}  // namespace
}  // namespace tarsier
