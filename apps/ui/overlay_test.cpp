// SPDX-License-Identifier: MIT
#include "ui/overlay.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <utility>

namespace tarsier {
namespace {

TEST(KeyName, IsTheLabelOfTheKey) {
  EXPECT_EQ(key_name('s'), "s");
  EXPECT_EQ(key_name('?'), "?");
  EXPECT_EQ(key_name(key::kSpace), "space");
  EXPECT_EQ(key_name(key::kEnter), "Enter");
  EXPECT_EQ(key_name(key::kEscape), "Esc");
  for (const int none : {0, key::kLeft, key::kUp, 7, 127, 300}) EXPECT_EQ(key_name(none), "");
}

// The panel grows with its lines: actions without a key have none.
TEST(DrawHelp, ListsOnlyActionsWithAKey) {
  const cv::Mat blank(400, 600, CV_8UC3, cv::Scalar::all(200));
  const auto drawn = [&](const std::vector<Action>& actions,
                         std::vector<image::draw::HelpLine> first) {
    cv::Mat image = blank.clone();
    draw_help(image, "Keys", actions, std::move(first));
    return image;
  };
  const Action sketch{"sketch", "pencil sketch", 's'};
  const cv::Mat one = drawn({sketch}, {});
  EXPECT_GT(cv::norm(one, blank, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(drawn({sketch, {"hidden", "has no key", 0}}, {}), one, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(drawn({}, {{"s", "pencil sketch"}}), one, cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(drawn({sketch, {"quit", "end", key::kEscape}}, {}), one, cv::NORM_INF), 0);
}

TEST(FrameTimer, ReportsFrameRateForVideosOnly) {
  FrameTimer timer;
  EXPECT_EQ(timer.text(false), "0.0 ms");
  timer.start();
  timer.stop();
  EXPECT_EQ(timer.mean_ms(), timer.last_ms());
  EXPECT_THAT(timer.text(true), ::testing::Not(::testing::HasSubstr("frames/s")));
  if (timer.mean_ms() > 0) {  // a clock may stand still for so short a time
    EXPECT_THAT(timer.text(false), ::testing::HasSubstr("frames/s"));
  }
}

}  // namespace
}  // namespace tarsier
