// SPDX-License-Identifier: MIT
#pragma once

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "ui/session.h"

namespace tarsier::test_support {

// For a session with something to show, and a host that shows status and keys itself: checks that
// the image has neither bar nor panel of keys, and has both when they are switched on.
inline void expect_plain_image(Session& session, const SourceStatus& source = {}) {
  session.draw_status(false);
  const cv::Mat plain = session.on_idle(source).image.clone();
  ASSERT_FALSE(plain.empty());
  const cv::Mat with_help = session.on_event(action_event("help")).image.clone();
  ASSERT_EQ(plain.size(), with_help.size());
  EXPECT_EQ(cv::norm(plain, with_help, cv::NORM_INF), 0) << "the panel of keys";
  (void)session.on_event(action_event("help"));
  session.draw_status(true);
  (void)session.on_event(action_event("help"));
  const cv::Mat with_bar = session.on_event(action_event("help")).image.clone();
  EXPECT_TRUE(with_bar.size() != plain.size() || cv::norm(plain, with_bar, cv::NORM_INF) > 0)
      << "the bar";
  session.draw_status(false);
  (void)session.on_event(action_event("help"));
  const cv::Mat after = session.on_event(action_event("help")).image;
  ASSERT_EQ(plain.size(), after.size());
  EXPECT_EQ(cv::norm(plain, after, cv::NORM_INF), 0);
}

}  // namespace tarsier::test_support
