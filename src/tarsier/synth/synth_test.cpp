// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/synth/clock.h"
#include "tarsier/synth/noise.h"
#include "tarsier/synth/portrait.h"
#include "tarsier/synth/scene.h"
#include "tarsier/synth/sources.h"
#include "tarsier/synth/testing_images.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <nlohmann/json.hpp>

namespace tarsier::synth {
namespace {

using std::chrono::milliseconds;
using ::testing::HasSubstr;

cv::Mat through_jpeg(const cv::Mat& image, int quality) {
  std::vector<std::uint8_t> bytes;
  cv::imencode(".jpg", image, bytes, {cv::IMWRITE_JPEG_QUALITY, quality});
  return cv::imdecode(bytes, cv::IMREAD_COLOR);
}

TEST(SynthClock, IsReadableAfterJpegNoiseAndResizing) {
  const ClockReading reading{4'000'000'123U, 0x0000'a5a5'1234'5678LL};
  for (const cv::Size size :
       {cv::Size(64, 48), cv::Size(320, 240), cv::Size(641, 479), cv::Size(1920, 1080)}) {
    cv::Mat image = render_clock(size, reading);
    add_noise(image, 6, 1);
    image = through_jpeg(image, 50);
    for (const double scale : {1.0, 1.3}) {
      cv::Mat resized;
      cv::resize(image, resized, {}, scale, scale, cv::INTER_AREA);
      const auto read = decode_clock(resized);
      ASSERT_TRUE(read.has_value()) << size << scale;
      EXPECT_EQ(read->frame, reading.frame);
      EXPECT_EQ(read->time_us, reading.time_us);
    }
  }
}

TEST(SynthClock, RejectsOtherImages) {
  EXPECT_FALSE(decode_clock(render_bars({320, 240})).has_value());
  EXPECT_FALSE(decode_clock(cv::Mat(240, 320, CV_8UC3, cv::Scalar::all(255))).has_value());
  EXPECT_FALSE(decode_clock(cv::Mat()).has_value());
  cv::Mat damaged = render_clock({320, 240}, {7, 8});
  cv::rectangle(damaged, {100, 20, 60, 60}, cv::Scalar::all(255), cv::FILLED);
  EXPECT_FALSE(decode_clock(damaged).has_value());
}

TEST(SynthNoise, HasGivenDeviationAndSeed) {
  cv::Mat image(200, 200, CV_8UC3, cv::Scalar::all(128));
  cv::Mat same = image.clone();
  cv::Mat other = image.clone();
  add_noise(image, 5, 1);
  add_noise(same, 5, 1);
  add_noise(other, 5, 2);
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(image, mean, deviation);
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(mean[k], 128, 0.2);
    EXPECT_NEAR(deviation[k], 5, 0.15);
  }
  EXPECT_TRUE(is_same(image, same));
  EXPECT_FALSE(is_same(image, other));
}

TEST(SynthScene, IsIndependentOfThreadsAndMoves) {
  const int threads = cv::getNumThreads();
  const cv::Mat image = render_scene({160, 120}, 1.5, 1);
  cv::setNumThreads(1);
  EXPECT_TRUE(is_same(image, render_scene({160, 120}, 1.5, 1)));
  cv::setNumThreads(threads);
  EXPECT_FALSE(is_same(image, render_scene({160, 120}, 2.5, 1)));
  EXPECT_FALSE(is_same(image, render_scene({160, 120}, 1.5, 2)));
}

TEST(SynthScene, HasContrastAndEdgesOfAPhoto) {
  const cv::Mat image = render_scene({320, 240});
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(gray, mean, deviation);
  EXPECT_GT(mean[0], 70);
  EXPECT_LT(mean[0], 170);
  EXPECT_GT(deviation[0], 30);
  // Neither overexposed nor too dark.
  EXPECT_LT(cv::countNonZero(gray > 250), gray.rows * gray.cols / 20);
  EXPECT_LT(cv::countNonZero(gray < 5), gray.rows * gray.cols / 20);
  // It has edges and texture, but is not noise.
  cv::Mat edges;
  cv::Canny(gray, edges, 60, 140);
  const double share =
      static_cast<double>(cv::countNonZero(edges)) / static_cast<double>(gray.total());
  EXPECT_GT(share, 0.02);
  EXPECT_LT(share, 0.25);
  for (const cv::Size size : {cv::Size(16, 16), cv::Size(33, 500), cv::Size(500, 33)}) {
    EXPECT_EQ(render_scene(size).size(), size);
  }
}

TEST(SynthPortrait, TruthMatchesImage) {
  for (const double time : {0.0, 1.0, 2.2}) {
    for (const std::uint64_t seed : {1U, 2U, 5U}) {
      const Portrait portrait = render_portrait({640, 480}, time, seed);
      cv::Mat gray;
      cv::cvtColor(portrait.image, gray, cv::COLOR_BGR2GRAY);
      for (const cv::Point2d& eye : portrait.truth.eyes) {
        EXPECT_TRUE(portrait.truth.box.contains(eye));
        const cv::Point at(cvRound(eye.x), cvRound(eye.y));
        EXPECT_LT(cv::mean(gray(cv::Rect(at.x - 1, at.y - 1, 3, 3)))[0], 60) << "a pupil";
        EXPECT_EQ(portrait.skin_mask.at<std::uint8_t>(at), 0);
      }
      EXPECT_LT(portrait.truth.eyes[0].x, portrait.truth.eyes[1].x);
      // The six seeds of the alien mode and the nose are on skin, the corners and the background
      // are not.
      const int w = 640;
      const int h = 480;
      for (const cv::Point seed_point :
           {cv::Point(w / 2, h / 2 - h / 6), cv::Point(w / 2 - w / 11, h / 2 - h / 6),
            cv::Point(w / 2 + w / 11, h / 2 - h / 6), cv::Point(w / 2, h / 2 + h / 16),
            cv::Point(w / 2 - w / 9, h / 2 + h / 16), cv::Point(w / 2 + w / 9, h / 2 + h / 16)}) {
        EXPECT_EQ(portrait.skin_mask.at<std::uint8_t>(seed_point), 255) << seed_point << time;
      }
      EXPECT_EQ(portrait.skin_mask.at<std::uint8_t>(5, 5), 0);
      const cv::Point2d mouth = (portrait.truth.mouth[0] + portrait.truth.mouth[1]) / 2;
      EXPECT_EQ(portrait.skin_mask.at<std::uint8_t>(cvRound(mouth.y) + 8, cvRound(mouth.x)), 0)
          << "lips";
      // The mask fills most of the box.
      const cv::Rect box = portrait.truth.box;
      EXPECT_GT(cv::mean(portrait.skin_mask(box))[0], 0.45 * 255);
    }
  }
}

TEST(SynthSource, GivesEachFrameWithItsTruth) {
  const auto source = open_synth_source("portrait?size=160x120&frames=3&fps=10");
  EXPECT_EQ(source->count(), 3);
  EXPECT_EQ(source->fps(), 10);
  EXPECT_FALSE(source->is_live());
  for (int i = 0; i < 3; ++i) {
    const auto frame = source->next(milliseconds(0), {});
    ASSERT_TRUE(frame.has_value());
    EXPECT_EQ(frame->index, i);
    EXPECT_DOUBLE_EQ(frame->time, 0.1 * i);
    EXPECT_FALSE(frame->still);
    EXPECT_EQ(frame->name, "synth:portrait?size=160x120&frames=3&fps=10");
    const auto truth = nlohmann::json::parse(frame->truth);
    EXPECT_EQ(truth.at("frame"), i);
    EXPECT_EQ(truth.at("box").size(), 4U);
    EXPECT_EQ(truth.at("eyes").at(1).size(), 2U);
  }
  EXPECT_TRUE(source->ended());
  EXPECT_FALSE(source->next(milliseconds(0), {}).has_value());
}

TEST(SynthSource, IsDeterministic) {
  for (const char* text : {"scene?size=80x60&frames=2", "portrait?size=80x60&frames=2",
                           "clock?size=80x60&frames=2", "bars?size=80x60&frames=2&noise=3"}) {
    const auto one = open_synth_source(text);
    const auto two = open_synth_source(text);
    for (int i = 0; i < 2; ++i) {
      const auto a = one->next(milliseconds(0), {});
      const auto b = two->next(milliseconds(0), {});
      EXPECT_TRUE(is_same(a->image, b->image)) << text;
      EXPECT_EQ(a->truth, b->truth);
    }
  }
}

TEST(SynthSource, LiveSourceKeepsTimeAndDropsUnreadFrames) {
  const auto source = open_synth_source("clock?size=64x48&fps=200&live=1");
  EXPECT_TRUE(source->is_live());
  EXPECT_EQ(source->count(), 0);
  const auto first = source->next(milliseconds(10'000), {});
  ASSERT_TRUE(first.has_value());
  // A late reader gets the newest frame.
  const auto wake = first->captured + milliseconds(60);
  while (std::chrono::steady_clock::now() < wake) {
  }
  const auto later = source->next(milliseconds(10'000), {});
  ASSERT_TRUE(later.has_value());
  EXPECT_GE(later->index, 11);
  EXPECT_EQ(source->status().dropped, later->index - 1);
  const auto reading = decode_clock(later->image);
  ASSERT_TRUE(reading.has_value());
  EXPECT_EQ(reading->frame, later->index);
  EXPECT_LE(reading->time_us, clock_now_us());
  std::stop_source stopper;
  stopper.request_stop();
  EXPECT_FALSE(source->next(milliseconds(10'000), stopper.get_token()).has_value());
}

TEST(SynthSource, ErrorsListChoices) {
  const auto reason = [](const std::string& text) -> std::string {
    try {
      (void)open_source("synth:" + text, {}, {synth_scheme()});
    } catch (const InputError& error) {
      return error.what();
    }
    return "nothing thrown";
  };
  EXPECT_THAT(reason("sceen"), HasSubstr("there are: scene, portrait, clock, bars"));
  EXPECT_THAT(reason("scene?color=red"), HasSubstr("unknown key 'color'; there are: size=640x480"));
  for (const char* text : {"scene?size=640", "scene?size=1x1", "scene?size=9999x9", "scene?fps=0",
                           "scene?fps=nan", "scene?frames=-1", "scene?live=2", "scene?noise=1000",
                           "scene?seed=x", "scene?size=", "", "clock?size=16x16"}) {
    EXPECT_THAT(reason(text), HasSubstr(std::string("synth:") + text + ": ")) << text;
  }
}

}  // namespace
}  // namespace tarsier::synth
