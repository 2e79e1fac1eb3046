// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/keyframes.h"

#include "tarsier/core/rng.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <set>
#include <stdexcept>
#include <vector>

namespace tarsier::sfm {
namespace {

constexpr int kWidth = 320;
constexpr int kHeight = 240;  // the diagonal is 400 px: min_motion 0.03 is 12 px

// A wall of random patches, wide enough for a moving view.
cv::Mat texture(std::uint64_t seed, int width = 900) {
  Rng rng(seed);
  cv::Mat wall(kHeight, width, CV_8UC3);
  wall.setTo(cv::Scalar(128, 128, 128));
  for (int k = 0; k < width * kHeight / 100; ++k) {
    const cv::Point corner(rng.integer(-20, width), rng.integer(-20, kHeight));
    const cv::Size size(rng.integer(4, 24), rng.integer(4, 24));
    const cv::Scalar color(rng.integer(0, 255), rng.integer(0, 255), rng.integer(0, 255));
    cv::rectangle(wall, cv::Rect(corner, size), color, cv::FILLED);
  }
  cv::GaussianBlur(wall, wall, {}, 0.7);
  return wall;
}

cv::Mat view(const cv::Mat& wall, int x) { return wall(cv::Rect(x, 0, kWidth, kHeight)).clone(); }

cv::Mat blurred(const cv::Mat& frame) {
  cv::Mat result;
  cv::GaussianBlur(frame, result, {}, 3);
  return result;
}

std::vector<Keyframe> pick(int frames, const std::function<cv::Mat(int)>& frame_of,
                           const KeyframeOptions& options = {}) {
  KeyframePicker picker(options);
  std::vector<Keyframe> result;
  for (int k = 0; k < frames; ++k) {
    if (auto key = picker.offer(frame_of(k), k, k / 25.0)) result.push_back(*key);
  }
  if (auto key = picker.finish()) result.push_back(*key);
  EXPECT_EQ(picker.count(), static_cast<int>(result.size()));
  for (std::size_t k = 1; k < result.size(); ++k) EXPECT_GT(result[k].index, result[k - 1].index);
  return result;
}

TEST(Keyframes, AreEvenlySpacedOnAnEvenMotion) {
  const cv::Mat wall = texture(1);
  const auto keys = pick(110, [&](int k) { return view(wall, 2 * k); });  // 6 frames per key frame
  ASSERT_GE(keys.size(), 15U);
  ASSERT_LE(keys.size(), 21U);
  EXPECT_EQ(keys[0].index, 0);
  EXPECT_GE(keys.back().index, 105);
  for (std::size_t k = 1; k < keys.size(); ++k) {
    const auto step = keys[k].index - keys[k - 1].index;
    EXPECT_LE(step, 8) << keys[k].index;
    if (k + 1 < keys.size()) {
      EXPECT_GE(step, 4) << keys[k].index;
    }
    EXPECT_NEAR(keys[k].motion * 400, 2.0 * static_cast<double>(step), 0.5) << keys[k].index;
    EXPECT_DOUBLE_EQ(keys[k].time, static_cast<double>(keys[k].index) / 25);
    const cv::Mat expected = view(wall, 2 * static_cast<int>(keys[k].index));
    EXPECT_EQ(cv::norm(keys[k].image, expected, cv::NORM_INF), 0);
  }
}

TEST(Keyframes, AStillCameraGivesOne) {
  const cv::Mat wall = texture(2);
  Rng rng(3);
  const auto keys = pick(50, [&](int) {
    cv::Mat frame = view(wall, 300);
    for (int y = 0; y < frame.rows; ++y) {  // noise of the sensor
      for (int x = 0; x < frame.cols; ++x) {
        cv::Vec3b& pixel = frame.at<cv::Vec3b>(y, x);
        const int noise = rng.integer(-6, 6);
        for (int c = 0; c < 3; ++c) pixel[c] = cv::saturate_cast<unsigned char>(pixel[c] + noise);
      }
    }
    return frame;
  });
  ASSERT_EQ(keys.size(), 1U);
  EXPECT_EQ(keys[0].index, 0);
}

TEST(Keyframes, AvoidBlur) {
  const cv::Mat wall = texture(4);
  Rng rng(5);
  std::set<std::int64_t> sharp{0};
  for (int k = 1; k < 80; ++k) {
    if (k % 3 == 0 || rng.uniform() < 0.2) sharp.insert(k);
  }
  const auto keys = pick(80, [&](int k) {
    const cv::Mat frame = view(wall, 2 * k);
    return sharp.contains(k) ? frame : blurred(frame);
  });
  EXPECT_GE(keys.size(), 8U);
  for (const Keyframe& key : keys) EXPECT_TRUE(sharp.contains(key.index)) << key.index;
}

TEST(Keyframes, IgnoreBlurOfAStillCamera) {
  const cv::Mat wall = texture(6);
  const auto keys = pick(60, [&](int k) {
    const cv::Mat frame = view(wall, 100);
    cv::Mat gone = frame;
    if (k >= 20 && k < 23) cv::blur(frame, gone, {60, 60});
    return gone;
  });
  EXPECT_EQ(keys.size(), 1U);
}

TEST(Keyframes, FollowAFastCameraAndACut) {
  const cv::Mat wall = texture(7);
  // 15 px, 3.75 % of the diagonal, from each frame to the next.
  const auto fast = pick(38, [&](int k) { return view(wall, 15 * k); });
  EXPECT_GE(fast.size(), 15U);
  for (std::size_t k = 1; k < fast.size(); ++k)
    EXPECT_LE(fast[k].index - fast[k - 1].index, 3) << fast[k].index;

  const cv::Mat other = texture(8);
  const auto cut = pick(40, [&](int k) { return view(k < 20 ? wall : other, 500); });
  ASSERT_EQ(cut.size(), 2U);
  EXPECT_GE(cut[1].index, 20);
}

TEST(Keyframes, BlackFramesGiveOne) {
  const auto black = [](int) { return cv::Mat(kHeight, kWidth, CV_8UC1, cv::Scalar(0)); };
  EXPECT_EQ(pick(20, black).size(), 1U);
  // The video begins after a fade-in and ends with a fade-out.
  const cv::Mat wall = texture(9);
  const auto keys = pick(55, [&](int k) {
    if (k < 10 || k >= 40) return cv::Mat(kHeight, kWidth, CV_8UC3, cv::Scalar(0, 0, 0));
    return view(wall, 2 * k);
  });
  EXPECT_GE(keys.size(), 4U);
  for (std::size_t k = 1; k < keys.size(); ++k) {
    EXPECT_GE(keys[k].index, 10);
    EXPECT_LT(keys[k].index, 40);
  }
}

TEST(Keyframes, AreAtMostMaxCount) {
  const cv::Mat wall = texture(10);
  const auto keys = pick(80, [&](int k) { return view(wall, 2 * k); }, {.max_count = 5});
  EXPECT_EQ(keys.size(), 5U);
}

TEST(Keyframes, AreDeterministic) {
  const cv::Mat wall = texture(11);
  const auto run = [&] {
    std::vector<std::int64_t> indices;
    for (const Keyframe& key : pick(40, [&](int k) { return view(wall, 3 * k); }))
      indices.push_back(key.index);
    return indices;
  };
  EXPECT_EQ(run(), run());
}

TEST(Keyframes, AreScaledToTheImage) {
  const cv::Mat wall = texture(12);
  const auto keys = pick(24, [&](int k) {
    cv::Mat large;
    cv::resize(view(wall, 3 * k), large, {5 * kWidth, 5 * kHeight}, 0, 0, cv::INTER_CUBIC);
    cv::cvtColor(large, large, cv::COLOR_BGR2GRAY);
    return large;
  });
  EXPECT_GE(keys.size(), 5U);
  EXPECT_LE(keys.size(), 9U);
  EXPECT_EQ(keys[1].image.size(), cv::Size(5 * kWidth, 5 * kHeight));
}

TEST(Keyframes, RefuseInvalidFrames) {
  EXPECT_THROW(KeyframePicker({.min_motion = 0}), std::invalid_argument);
  EXPECT_THROW(KeyframePicker({.window = 0}), std::invalid_argument);
  EXPECT_THROW(KeyframePicker({.max_count = 0}), std::invalid_argument);
  KeyframePicker picker;
  const cv::Mat frame(kHeight, kWidth, CV_8UC3, cv::Scalar(1, 2, 3));
  EXPECT_THROW((void)picker.offer({}, 0, 0), std::invalid_argument);
  EXPECT_FALSE(picker.finish());
  EXPECT_TRUE(picker.offer(frame, 5, 0));
  EXPECT_THROW((void)picker.offer(frame, 5, 0), std::invalid_argument);
  EXPECT_THROW((void)picker.offer(frame.t(), 6, 0), std::invalid_argument);
  EXPECT_FALSE(picker.finish());
}

}  // namespace
}  // namespace tarsier::sfm
