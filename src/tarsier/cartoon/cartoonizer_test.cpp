// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/cartoonizer.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/face/detect/cascade.h"
#include "tarsier/face/detect/detector.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace tarsier::cartoon {
namespace {

// A box on a noisy background; `step` moves it.
Frame frame_of(int step = 0) {
  Frame frame;
  frame.image.create(96, 128, CV_8UC3);
  Rng rng(static_cast<std::uint64_t>(step) + 1);
  for (int y = 0; y < frame.image.rows; ++y) {
    for (int x = 0; x < frame.image.cols; ++x) {
      const bool inside = x > 30 + step && x < 80 + step && y > 20 && y < 70;
      const int gray = inside ? 60 : 100 + 3 * (x / 8 % 4);
      frame.image.at<cv::Vec3b>(y, x) =
          cv::Vec3b::all(static_cast<std::uint8_t>(gray + rng.integer(-12, 12)));
    }
  }
  frame.index = step;
  frame.time = step / 10.0;
  frame.name = "drawn";
  return frame;
}

CartoonOptions steady_sketch() {
  CartoonOptions options;
  options.mode = Mode::kSketch;
  options.steady.on = true;
  return options;
}

bool same(const cv::Mat& a, const cv::Mat& b) { return cv::norm(a, b, cv::NORM_INF) == 0; }

TEST(Cartoonizer, MatchesCartoonize) {
  for (const Mode mode : all_modes()) {
    CartoonOptions options;
    options.mode = mode;
    const auto cartoonizer = Cartoonizer::load({}, options);
    CartoonizerState state;
    const CartoonResult result = cartoonizer.process(frame_of(), state);
    CartoonState other;
    EXPECT_TRUE(same(result.image, cartoonize(frame_of().image, options, other))) << name_of(mode);
    EXPECT_EQ(result.mode, mode);
    EXPECT_GT(result.ms, 0);
  }
}

TEST(Cartoonizer, ResultHasModeTimeAndFaces) {
  CartoonResult result;
  result.mode = Mode::kEvilSketch;
  result.ms = 1.23456;
  result.faces = {{1, 2, 30, 40}};
  EXPECT_EQ(to_json(result).dump(), R"({"mode":"evil-sketch","ms":1.23,"faces":[[1,2,30,40]]})");
}

// --- state between frames ---

TEST(Cartoonizer, ResetsHistoryForAnotherVideo) {
  const auto cartoonizer = Cartoonizer::load({}, steady_sketch());
  const auto fresh = [&](const Frame& frame) {
    CartoonizerState state;
    return cartoonizer.process(frame, state).image.clone();
  };
  CartoonizerState state;
  for (int step = 0; step < 6; ++step) (void)cartoonizer.process(frame_of(step), state);
  const cv::Mat followed = cartoonizer.process(frame_of(6), state).image.clone();
  EXPECT_FALSE(same(followed, fresh(frame_of(6)))) << "lines are not steady";
  Frame earlier = frame_of(9);
  earlier.time = 0.2;  // another video, or the same video from its start
  EXPECT_TRUE(same(cartoonizer.process(earlier, state).image, fresh(earlier)));
  Frame still = frame_of(3);
  still.time = 0.9;
  still.still = true;
  EXPECT_TRUE(same(cartoonizer.process(still, state).image, fresh(still)));
}

TEST(Cartoonizer, DrawsAFrameAgainWithOtherOptions) {
  auto cartoonizer = Cartoonizer::load({}, steady_sketch());
  CartoonizerState once;
  CartoonizerState twice;
  for (int step = 0; step < 5; ++step) {
    (void)cartoonizer.process(frame_of(step), once);
    (void)cartoonizer.process(frame_of(step), twice);
  }
  CartoonOptions options = steady_sketch();
  options.mode = Mode::kPaint;  // draws no lines, and keeps the lines of the state
  cartoonizer.set_options(options);
  EXPECT_EQ(cartoonizer.process(frame_of(4), twice).mode, Mode::kPaint);
  cartoonizer.set_options(steady_sketch());
  EXPECT_TRUE(same(cartoonizer.process(frame_of(5), once).image,
                   cartoonizer.process(frame_of(5), twice).image));
}

TEST(Cartoonizer, DoesNotOverwriteHeldImage) {
  const auto cartoonizer = Cartoonizer::load({}, {});
  CartoonizerState state;
  const CartoonResult held = cartoonizer.process(frame_of(0), state);
  const cv::Mat copy = held.image.clone();
  (void)cartoonizer.process(frame_of(20), state);
  EXPECT_TRUE(same(held.image, copy));
  // An output image that nobody else holds is used again.
  const auto* first = cartoonizer.process(frame_of(21), state).image.data;
  EXPECT_EQ(cartoonizer.process(frame_of(22), state).image.data, first);
}

// --- checks of the input ---

TEST(Cartoonizer, RejectsTooSmallFrame) {
  const auto cartoonizer = Cartoonizer::load({}, {});
  CartoonizerState state;
  Frame frame = frame_of();
  frame.image = cv::Mat(8, 40, CV_8UC3, cv::Scalar::all(9));
  try {
    (void)cartoonizer.process(frame, state);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_STREQ(error.what(), "drawn: 40x8 is too small to draw; at least 16x16 is needed");
  }
  frame.image = cv::Mat(40, 40, CV_8UC1, cv::Scalar(9));
  EXPECT_THROW((void)cartoonizer.process(frame, state), std::invalid_argument);
  frame.image = cv::Mat();
  EXPECT_THROW((void)cartoonizer.process(frame, state), std::invalid_argument);
  CartoonOptions bad;
  bad.sketch.threshold = 999;
  EXPECT_THROW((void)Cartoonizer::load({}, bad), std::invalid_argument);
}

class FaceCascade : public FolderTest {};

TEST_F(FaceCascade, IsRequiredBeforeFirstFrame) {
  CartoonOptions options;
  options.mode = Mode::kAlien;
  options.skin.face = FaceMode::kAuto;
  options.skin.cascade = path("missing.xml");
  EXPECT_THROW((void)Cartoonizer::load({}, options), ModelError);
  options.mode = Mode::kCartoon;  // needs no model
  auto cartoonizer = Cartoonizer::load({}, options);
  options.mode = Mode::kSmooth;
  EXPECT_THROW(cartoonizer.set_options(options), ModelError);
  EXPECT_EQ(cartoonizer.options().mode, Mode::kCartoon) << "options that are refused are not taken";
}

TEST_F(FaceCascade, OfStoreTakesPrecedence) {
  const std::string default_cascade = face::find_cascade(Cartoonizer::kFaceCascade);
  if (default_cascade.empty()) GTEST_SKIP() << "no cascade files (Debian: opencv-data)";
  CartoonOptions options;
  options.mode = Mode::kAlien;
  options.skin.face = FaceMode::kAuto;
  EXPECT_EQ(Cartoonizer::load(ModelStore(folder_), options).options().skin.cascade, "");
  std::filesystem::copy_file(default_cascade, path(Cartoonizer::kFaceCascade));
  const auto cartoonizer = Cartoonizer::load(ModelStore(folder_), options);
  EXPECT_EQ(cartoonizer.options().skin.cascade, path(Cartoonizer::kFaceCascade));
  CartoonizerState state;
  EXPECT_TRUE(cartoonizer.process(frame_of(), state).faces.empty()) << "there is no face";
}

}  // namespace
}  // namespace tarsier::cartoon
