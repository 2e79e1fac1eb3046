// SPDX-License-Identifier: MIT
#pragma once

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "ui/session.h"

namespace tarsier::testing {

// For a session with something to show, and a host that shows status and keys itself: checks that
// the image has neither bar nor panel of keys, and has both when they are switched on.
inline void expect_plain_image(Session& session, const SourceStatus& source = {}) {
  session.draw_status(false);
  const cv::Mat plain = session.on_idle(source).image.clone();
  ASSERT_FALSE(plain.empty());
  const cv::Mat asked = session.on_event(action_event("help")).image.clone();
  ASSERT_EQ(plain.size(), asked.size());
  EXPECT_EQ(cv::norm(plain, asked, cv::NORM_INF), 0) << "the panel of keys";
  (void)session.on_event(action_event("help"));
  session.draw_status(true);
  (void)session.on_event(action_event("help"));
  const cv::Mat barred = session.on_event(action_event("help")).image.clone();
  EXPECT_TRUE(barred.size() != plain.size() || cv::norm(plain, barred, cv::NORM_INF) > 0)
      << "the bar";
  session.draw_status(false);
  (void)session.on_event(action_event("help"));
  const cv::Mat again = session.on_event(action_event("help")).image;
  ASSERT_EQ(plain.size(), again.size());
  EXPECT_EQ(cv::norm(plain, again, cv::NORM_INF), 0);
}

}  // namespace tarsier::testing
