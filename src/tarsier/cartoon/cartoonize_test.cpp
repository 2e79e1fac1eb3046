// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/cartoonize.h"

#include "tarsier/cartoon/reference.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::cartoon {
namespace {

using testing::HasSubstr;

// A face-coloured ellipse with eyes in front of shapes on a gradient, with sensor noise.
cv::Mat test_frame(cv::Size size = {320, 240}, std::uint64_t seed = 1, double noise = 2) {
  cv::Mat frame(size, CV_8UC3);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      frame.at<cv::Vec3b>(y, x) = {static_cast<std::uint8_t>(120 + 80 * x / size.width), 90,
                                   static_cast<std::uint8_t>(60 + 60 * y / size.height)};
    }
  }
  const int h = size.height;
  const cv::Point middle(size.width / 2, h / 2);
  cv::rectangle(frame, {8, 10, size.width / 5, h / 3}, {40, 200, 220}, cv::FILLED);
  cv::circle(frame, {size.width * 7 / 8, h * 3 / 4}, h / 9, {30, 30, 30}, cv::FILLED, cv::LINE_AA);
  cv::ellipse(frame, middle, {h / 4, h / 3}, 0, 0, 360, {120, 150, 210}, cv::FILLED, cv::LINE_AA);
  for (const int side : {-1, 1}) {
    cv::circle(frame, {middle.x + side * h / 10, middle.y - h / 20}, h / 40, {30, 20, 20},
               cv::FILLED, cv::LINE_AA);
  }
  Rng rng(seed);
  for (int y = 0; y < size.height; ++y) {
    auto* row = frame.ptr(y);
    for (int x = 0; x < 3 * size.width; ++x) {
      row[x] = cv::saturate_cast<std::uint8_t>(row[x] + rng.normal(0, noise));
    }
  }
  return frame;
}

cv::Mat run(const cv::Mat& frame, const CartoonOptions& options) {
  CartoonState state;
  return cartoonize(frame, options, state).clone();
}

double share_of_difference(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat gray;
  cv::Mat difference;
  cv::absdiff(a, b, difference);
  cv::cvtColor(difference, gray, cv::COLOR_BGR2GRAY);
  return cv::countNonZero(gray) / static_cast<double>(gray.total());
}

class EveryMode : public testing::TestWithParam<Mode> {};
INSTANTIATE_TEST_SUITE_P(Modes, EveryMode, testing::ValuesIn(all_modes()),
                         [](const testing::TestParamInfo<Mode>& mode) {
                           std::string name(name_of(mode.param));
                           std::erase(name, '-');
                           return name;
                         });

TEST_P(EveryMode, FastQualityMatchesReference) {
  for (const cv::Size size : {cv::Size(320, 240), cv::Size(161, 97)}) {
    const cv::Mat frame = test_frame(size);
    CartoonOptions options;
    options.mode = GetParam();
    const cv::Mat expected = reference::cartoonize(frame, options);
    const cv::Mat fast = run(frame, options);
    ASSERT_EQ(fast.size(), size);
    EXPECT_GT(cv::PSNR(fast, expected), 45) << size;
    options.quality = Quality::kReference;
    EXPECT_EQ(cv::norm(run(frame, options), expected, cv::NORM_INF), 0) << size;
  }
}

TEST_P(EveryMode, DoesNotDependOnTheNumberOfThreads) {
  const cv::Mat frame = test_frame();
  CartoonOptions options;
  options.mode = GetParam();
  const int before = cv::getNumThreads();
  cv::setNumThreads(1);
  const cv::Mat one = run(frame, options);
  cv::setNumThreads(2);
  const cv::Mat two = run(frame, options);
  cv::setNumThreads(before);
  EXPECT_EQ(cv::norm(one, two, cv::NORM_INF), 0);
}

TEST_P(EveryMode, StateIsReusableForAnotherSizeAndMode) {
  CartoonOptions options;
  options.mode = GetParam();
  CartoonState state;
  (void)cartoonize(test_frame({64, 48}), options, state);
  options.mode = Mode::kNone;
  const cv::Mat frame = test_frame({160, 120});
  (void)cartoonize(frame, options, state);
  options.mode = GetParam();
  const cv::Mat untouched = frame.clone();
  const cv::Mat again = cartoonize(frame, options, state).clone();
  EXPECT_EQ(cv::norm(frame, untouched, cv::NORM_INF), 0) << "the caller's frame was written to";
  EXPECT_EQ(cv::norm(again, run(frame, options), cv::NORM_INF), 0);
}

TEST(Masks, AreBitExact) {
  for (const Mode mode : {Mode::kSketch, Mode::kEvilSketch}) {
    for (const bool both_axes : {false, true}) {
      CartoonOptions options;
      options.mode = mode;
      options.evil.both_axes = both_axes;
      const cv::Mat frame = test_frame({333, 217}, 9, 12);
      EXPECT_EQ(cv::norm(run(frame, options), reference::cartoonize(frame, options), cv::NORM_INF),
                0);
    }
  }
}

TEST(Masks, MatchReferenceWithOtherOptions) {
  CartoonOptions options;
  options.mode = Mode::kSketch;
  options.sketch = {.median_size = 5, .laplacian_size = 3, .threshold = 20, .remove_pepper = false};
  const cv::Mat frame = test_frame();
  EXPECT_EQ(cv::norm(run(frame, options), reference::cartoonize(frame, options), cv::NORM_INF), 0);
  options.mode = Mode::kEvilSketch;
  options.evil = {.both_axes = true, .threshold = 40, .median_size = 5};
  EXPECT_EQ(cv::norm(run(frame, options), reference::cartoonize(frame, options), cv::NORM_INF), 0);
}

TEST(Pepper, RemovesIsolatedSpotsAndKeepsLines) {
  cv::Mat mask(20, 30, CV_8UC1, cv::Scalar(255));
  mask.at<std::uint8_t>(8, 8) = 0;
  cv::rectangle(mask, {20, 10, 2, 2}, 0, cv::FILLED);
  cv::line(mask, {2, 16}, {27, 16}, 0);
  reference::remove_pepper(mask);
  EXPECT_EQ(mask.at<std::uint8_t>(8, 8), 255);
  EXPECT_EQ(cv::countNonZero(mask(cv::Rect(18, 8, 6, 6)) == 0), 0);
  EXPECT_EQ(cv::countNonZero(mask == 0), 26);
}

TEST(Paint, UnusualSigmaFallsBackToOpenCv) {
  CartoonOptions options;
  options.mode = Mode::kPaint;
  options.paint.sigma_color = 40;
  options.paint.rounds = 1;
  const cv::Mat frame = test_frame({96, 64});
  EXPECT_EQ(cv::norm(run(frame, options), reference::cartoonize(frame, options), cv::NORM_INF), 0);
}

TEST(Alien, ColorsOnlySkin) {
  const cv::Mat frame = test_frame();
  CartoonOptions options;
  options.mode = Mode::kPaint;
  const cv::Mat painted = run(frame, options);
  options.mode = Mode::kAlien;
  const cv::Mat alien = run(frame, options);
  const cv::Point cheek(160 + 15, 120 + 25);
  EXPECT_EQ(alien.at<cv::Vec3b>(cheek)[1], painted.at<cv::Vec3b>(cheek)[1] + 70);
  EXPECT_EQ(alien.at<cv::Vec3b>(cheek)[2], painted.at<cv::Vec3b>(cheek)[2]);
  const cv::Point background(160, 10);
  EXPECT_EQ(alien.at<cv::Vec3b>(background), painted.at<cv::Vec3b>(background));
}

TEST(Smooth, OnlySkinIsSmoothed) {
  const cv::Mat frame = test_frame();
  CartoonOptions options;
  options.mode = Mode::kSmooth;
  const cv::Mat smooth = run(frame, options);
  const cv::Rect background(60, 4, 60, 30);
  EXPECT_EQ(cv::norm(smooth(background), frame(background), cv::NORM_INF), 0);
  const cv::Rect cheek(160 + 6, 120 + 15, 20, 20);
  cv::Scalar mean;
  cv::Scalar before;
  cv::Scalar after;
  cv::meanStdDev(frame(cheek), mean, before);
  cv::meanStdDev(smooth(cheek), mean, after);
  EXPECT_LT(after[1], 0.5 * before[1]);
}

TEST(Steady, StillLinesFlickerLess) {
  CartoonOptions options;
  options.mode = Mode::kSketch;
  std::vector<double> flips;
  for (const bool on : {false, true}) {
    options.steady.on = on;
    CartoonState state;
    cv::Mat last;
    double sum = 0;
    for (std::uint64_t i = 0; i < 12; ++i) {
      const cv::Mat now = cartoonize(test_frame({320, 240}, 100 + i, 8), options, state).clone();
      if (i > 2) sum += share_of_difference(now, last);
      last = now;
    }
    flips.push_back(sum);
  }
  EXPECT_LT(flips[1], 0.5 * flips[0]);
}

TEST(Steady, MovingEdgesDoNotTrail) {
  CartoonOptions options;
  options.mode = Mode::kSketch;
  options.steady.on = true;
  CartoonState state;
  cv::Mat last;
  cv::Mat frame;
  for (int i = 0; i < 10; ++i) {
    frame = cv::Mat(120, 200, CV_8UC3, cv::Scalar::all(90));
    cv::rectangle(frame, {10 + 9 * i, 30, 40, 60}, cv::Scalar::all(150), cv::FILLED);
    last = cartoonize(frame, options, state).clone();
  }
  options.steady.on = false;
  EXPECT_LT(share_of_difference(last, run(frame, options)), 0.002);
}

TEST(Steady, ResetDiscardsHistory) {
  CartoonOptions options;
  options.steady.on = true;
  CartoonState state;
  (void)cartoonize(test_frame({160, 120}, 1), options, state);
  state.reset();
  const cv::Mat other = test_frame({160, 120}, 2, 20);
  const cv::Mat after = cartoonize(other, options, state).clone();
  EXPECT_EQ(cv::norm(after, run(other, options), cv::NORM_INF), 0);
}

class Names : public DebugSink {
 public:
  void image(std::string_view name, const cv::Mat& image) override {
    EXPECT_FALSE(image.empty()) << name;
    names.emplace_back(name);
  }
  std::vector<std::string> names;
};

TEST(Debug, ReportsEveryStageOnce) {
  CartoonOptions options;
  options.mode = Mode::kAlien;
  CartoonState state;
  Names names;
  Timers timers;
  (void)cartoonize(test_frame(), options, state, &names, &timers);
  EXPECT_THAT(names.names,
              testing::ElementsAre("frame", "grey", "median", "laplacian", "threshold", "pepper",
                                   "half size", "painting", "skin", "coloured", "result"));
  EXPECT_THAT(timers.report(), HasSubstr("bilateral"));
}

TEST(Buffers, AreReusedBetweenFrames) {
  CartoonOptions options;
  CartoonState state;
  const auto* first = cartoonize(test_frame(), options, state).data;
  const auto* second = cartoonize(test_frame(), options, state).data;
  EXPECT_EQ(first, second);
}

TEST(Buffers, DoNotOverwriteHeldImage) {
  CartoonOptions options;
  CartoonState state;
  const cv::Mat kept = cartoonize(test_frame({64, 64}, 1), options, state);
  const cv::Mat copy = kept.clone();
  (void)cartoonize(test_frame({64, 64}, 2, 30), options, state);
  EXPECT_EQ(cv::norm(kept, copy, cv::NORM_INF), 0);
}

TEST(Options, ErrorsNameValueOutOfRange) {
  CartoonOptions options;
  options.paint.diameter = 8;
  try {
    options.check();
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), HasSubstr("paint.diameter 8: expected 3..15, odd"));
  }
  EXPECT_THROW((void)parse_mode("crayon"), std::invalid_argument);
  for (const Mode mode : all_modes()) EXPECT_EQ(parse_mode(name_of(mode)), mode);
}

TEST(Options, RejectInvalidFrames) {
  CartoonState state;
  EXPECT_THROW((void)cartoonize(cv::Mat(), {}, state), std::invalid_argument);
  EXPECT_THROW((void)cartoonize(cv::Mat(100, 100, CV_8UC1, cv::Scalar(0)), {}, state),
               std::invalid_argument);
  EXPECT_THROW((void)cartoonize(cv::Mat(8, 100, CV_8UC3, cv::Scalar::all(0)), {}, state),
               std::invalid_argument);
}

TEST(Reference, PaintingIsInterruptible) {
  std::stop_source source;
  source.request_stop();
  CartoonState state;
  CartoonOptions options;
  options.mode = Mode::kPaint;
  options.quality = Quality::kReference;
  EXPECT_THROW((void)cartoonize(test_frame(), options, state, nullptr, nullptr, source.get_token()),
               Interrupted);
  const cv::Mat after = cartoonize(test_frame(), options, state);
  EXPECT_EQ(cv::norm(after, run(test_frame(), options), cv::NORM_INF), 0)
      << "the same state draws the frame as if nothing had been interrupted";
}

TEST(Outline, IsBlendedByItsOpacity) {
  const cv::Mat frame(240, 320, CV_8UC3, cv::Scalar::all(50));
  cv::Mat shown = frame.clone();
  draw_face_outline(shown, 0);
  EXPECT_EQ(cv::norm(shown, frame, cv::NORM_INF), 0);
  draw_face_outline(shown, 1);
  const int top = 240 / 2 - (240 * 70 / 100) / 2;
  EXPECT_GT(shown.at<cv::Vec3b>(top, 160)[2], 150) << "the top of the ellipse";
  EXPECT_EQ(shown.at<cv::Vec3b>(120, 5), cv::Vec3b(50, 50, 50));
}

}  // namespace
}  // namespace tarsier::cartoon
