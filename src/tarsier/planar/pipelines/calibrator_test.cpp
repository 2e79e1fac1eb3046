// SPDX-License-Identifier: MIT
#include "tarsier/planar/pipelines/calibrator.h"

#include "tarsier/core/errors.h"
#include "tarsier/synth/boards.h"
#include "tarsier/synth/sources.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace tarsier::planar {
namespace {

using calibration::BoardSpec;
using calibration::ViewDecision;
using ::testing::HasSubstr;

const cv::Size kSize{480, 360};

BoardSpec board() { return calibration::parse_board("chess:9x6", 0.025); }

synth::BoardVideo board_video() { return {kSize, board(), 1}; }

CalibratorOptions options() {
  CalibratorOptions options;
  options.board = board();
  return options;
}

CalibratorOptions live_options() {
  CalibratorOptions options = live_calibrator_options();
  options.board = board();
  return options;
}

// Synthetic images of the board, each at another position and tilt.
const std::vector<cv::Mat>& stills() {
  static const std::vector<cv::Mat> images = [] {
    std::vector<cv::Mat> list;
    const geometry::Camera camera = board_video().camera();
    const synth::BoardRenderer renderer(camera, board());
    for (const geometry::Rigid3& pose : synth::board_poses(camera, board(), 8, 3))
      list.push_back(renderer.render(pose, {}));
    return list;
  }();
  return images;
}

Frame still(const cv::Mat& image, const std::string& name = "still.png") {
  Frame frame;
  frame.image = image;
  frame.name = name;
  frame.still = true;
  return frame;
}

Frame moment(const cv::Mat& image, int index, const std::string& name = "board.mp4") {
  Frame frame;
  frame.image = image;
  frame.name = name;
  frame.index = index;
  frame.time = index / 10.0;
  return frame;
}

TEST(Calibrator, CalibratesFromImages) {
  const auto calibrator = Calibrator::load(options());
  CalibratorState state;
  for (const cv::Mat& image : stills())
    EXPECT_TRUE(calibrator.process(still(image), state).is_accepted());
  const cv::Mat nothing(kSize, CV_8UC3, cv::Scalar::all(120));
  EXPECT_EQ(calibrator.process(still(nothing, "nothing.png"), state).decision,
            ViewDecision::kNoBoard);
  const auto result = calibrator.calibrate(state);
  ASSERT_TRUE(result.ok()) << result.calibration.refusal;
  EXPECT_NEAR(result.calibration.camera.fx / board_video().camera().fx, 1, 5e-3);
  EXPECT_EQ(result.calibration.used, 8);
  EXPECT_EQ(result.images.size(), 9U);
  EXPECT_EQ(result.coverage.views, 8);
  const auto line = to_json(result, result.images.back());
  EXPECT_EQ(line["image"], "nothing.png");
  EXPECT_EQ(line["reason"], "no board");
  EXPECT_EQ(line["used"], false);
  const auto good = to_json(result, result.images.front());
  EXPECT_EQ(good["points"], 54);
  EXPECT_EQ(good["rvec"].size(), 3U);
  const auto all = to_json(result);
  std::string keys;
  for (const auto& item : all.items()) keys += item.key() + " ";
  EXPECT_EQ(keys,
            "model board width height fx fy cx cy distortion rms deviations images used coverage "
            "missing warnings ");
  EXPECT_EQ(all["images"], 9);
}

TEST(Calibrator, AcceptsNewViewsOfVideo) {
  CalibratorOptions how = options();
  how.keep_images = true;
  how.examine_every_s = 0.3;
  how.collect.max_views = 6;
  const auto calibrator = Calibrator::load(how);
  CalibratorState state;
  NoProgress progress;
  const auto source = synth::open_synth_source("board?size=480x360&fps=10&frames=120");
  calibrator.search(*source, state, progress);
  EXPECT_EQ(state.views.size(), 6U);
  EXPECT_EQ(state.images.size(), 40U);  // every third frame
  int found = 0;
  for (const CalibrationImage& image : state.images) {
    found += image.found ? 1 : 0;
    EXPECT_EQ(image.found, !image.image.empty());
    EXPECT_EQ(image.found, image.reason.empty());
  }
  EXPECT_EQ(found, 6);
  const auto result = calibrator.calibrate(state);
  ASSERT_TRUE(result.ok()) << result.calibration.refusal;
  EXPECT_NEAR(result.calibration.camera.fx / board_video().camera().fx, 1, 1e-2);
}

TEST(Calibrator, SharperViewReplacesSimilarOne) {
  CalibratorOptions how = options();
  how.collect.min_sharpness = 0;
  const auto calibrator = Calibrator::load(how);
  CalibratorState state;
  cv::Mat blurred;
  cv::GaussianBlur(stills()[0], blurred, {}, 1.5);
  EXPECT_EQ(calibrator.process(moment(blurred, 0), state).decision, ViewDecision::kAccepted);
  EXPECT_EQ(calibrator.process(moment(stills()[0], 1), state).decision, ViewDecision::kReplaced);
  EXPECT_EQ(calibrator.process(moment(stills()[0], 2), state).decision, ViewDecision::kTooSimilar);
  ASSERT_EQ(state.images.size(), 3U);
  EXPECT_EQ(state.views.size(), 1U);
  EXPECT_FALSE(state.images[0].found);
  EXPECT_EQ(state.images[0].reason, "alike");
  EXPECT_TRUE(state.images[1].found);
  // In another board_video, the same position is new.
  EXPECT_EQ(calibrator.process(moment(stills()[0], 0, "other.mp4"), state).decision,
            ViewDecision::kAccepted);
  EXPECT_EQ(state.views.size(), 2U);
}

TEST(Calibrator, UsesMostFrequentImageSize) {
  const auto calibrator = Calibrator::load(options());
  CalibratorState state;
  cv::Mat larger;
  cv::resize(stills()[0], larger, {}, 1.5, 1.5, cv::INTER_CUBIC);
  (void)calibrator.process(still(larger, "larger.png"), state);
  for (const cv::Mat& image : stills()) (void)calibrator.process(still(image), state);
  const auto result = calibrator.calibrate(state);
  ASSERT_TRUE(result.ok()) << result.calibration.refusal;
  EXPECT_EQ(result.size, kSize);
  EXPECT_EQ(result.calibration.used, 8);
  const auto line = to_json(result, result.images[0]);
  EXPECT_EQ(line["found"], true);
  EXPECT_EQ(line["used"], false);
  EXPECT_EQ(line["reason"], "720x540 px, most others have 480x360");
}

TEST(Calibrator, ReportsWhyThereIsNoCamera) {
  const auto calibrator = Calibrator::load(options());
  CalibratorState state;
  EXPECT_THROW((void)calibrator.calibrate(state), std::invalid_argument);
  (void)calibrator.process(still(stills()[0]), state);
  const auto result = calibrator.calibrate(state);
  EXPECT_FALSE(result.ok());
  const auto json = to_json(result);
  EXPECT_THAT(json["refusal"].get<std::string>(), HasSubstr("1 view"));
  EXPECT_EQ(json["images"], 1);
  EXPECT_EQ(to_json(result, result.images[0])["used"], false);
}

TEST(Calibrator, SuggestsOtherBoard) {
  CalibratorOptions how = options();
  how.board = calibration::parse_board("chess:8x6", 0.025);
  const auto calibrator = Calibrator::load(how);
  CalibratorState state;
  EXPECT_FALSE(calibrator.other_board(state));
  EXPECT_EQ(calibrator.process(still(stills()[0]), state).decision, ViewDecision::kNoBoard);
  EXPECT_EQ(calibrator.other_board(state), "9x6");
}

TEST(Calibrator, AcceptsStillLiveViews) {
  const auto calibrator = Calibrator::load(live_options());
  CalibratorState state;
  EXPECT_EQ(calibrator.process(moment(stills()[0], 0), state).decision, ViewDecision::kMoving);
  EXPECT_EQ(calibrator.process(moment(stills()[0], 1), state).decision, ViewDecision::kAccepted);
  EXPECT_EQ(calibrator.process(moment(stills()[3], 2), state).decision, ViewDecision::kMoving);
  EXPECT_EQ(state.images.size(), 1U);  // only those with a view
  // take() takes it anyway, and forget_last() removes it.
  EXPECT_TRUE(calibrator.take(state).is_accepted());
  EXPECT_EQ(state.views.size(), 2U);
  EXPECT_EQ(state.images[1].index, 2);
  EXPECT_EQ(state.collector->coverage().views, 2);
  calibrator.forget_last(state);
  EXPECT_EQ(state.views.size(), 1U);
  EXPECT_EQ(state.images.size(), 1U);
  EXPECT_EQ(state.collector->coverage().views, 1);
  // An image of another size is not used.
  cv::Mat larger;
  cv::resize(stills()[0], larger, {}, 1.5, 1.5);
  EXPECT_FALSE(calibrator.process(moment(larger, 3), state).decision);
  EXPECT_EQ(calibrator.take(state).decision, ViewDecision::kNoBoard);
}

TEST(Calibrator, SearchesEveryThirdLiveFrameWithoutBoard) {
  const auto calibrator = Calibrator::load(live_options());
  CalibratorState state;
  const cv::Mat nothing(kSize, CV_8UC3, cv::Scalar::all(120));
  for (int i = 0; i < 24; ++i) (void)calibrator.process(moment(nothing, i), state);
  EXPECT_EQ(state.frames_without_board, 24);
  EXPECT_EQ(state.searches_without_board, 18);  // 15, then frames 15, 18 and 21
  EXPECT_TRUE(state.images.empty());
}

TEST(Calibrator, RemovesViewOfVideo) {
  const auto calibrator = Calibrator::load(options());
  CalibratorState state;
  (void)calibrator.process(moment(stills()[0], 0), state);
  (void)calibrator.process(moment(stills()[3], 1), state);
  ASSERT_EQ(state.views.size(), 2U);
  calibrator.forget_last(state);
  EXPECT_EQ(state.views.size(), 1U);
  EXPECT_EQ(state.images[1].reason, "forgotten");
  EXPECT_TRUE(calibrator.process(moment(stills()[3], 2), state).is_accepted());
  calibrator.forget_last(state);
  calibrator.forget_last(state);
  calibrator.forget_last(state);
  EXPECT_TRUE(state.views.empty());
}

TEST(Calibrator, RejectsInvalidOptions) {
  CalibratorOptions how = options();
  how.search_px = 3;
  EXPECT_THROW((void)Calibrator::load(how), std::invalid_argument);
  how = options();
  how.every = 0;
  EXPECT_THROW((void)Calibrator::load(how), std::invalid_argument);
  CalibratorState state;
  EXPECT_THROW((void)Calibrator::load(options()).process(still({}), state), std::invalid_argument);
  EXPECT_THROW((void)Calibrator::load(options()).take(state), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::planar
