// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/disguise.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <cmath>
#include <vector>

namespace tarsier::face::training {
namespace {

// 68 points on circles and lines, roughly those of a face `width` px wide with its eyes at `eyes`.
std::vector<cv::Point2d> drawn_face(cv::Point2d eyes, double width) {
  std::vector<cv::Point2d> points;
  const auto add = [&](double x, double y) { points.push_back(eyes + width * cv::Point2d(x, y)); };
  for (int i = 0; i < 17; ++i) {
    const double angle = CV_PI * (16 - i) / 16;
    add(0.5 * std::cos(angle), 0.75 * std::sin(angle));
  }
  for (int i = 0; i < 5; ++i) add(-0.4 + 0.07 * i, -0.12);
  for (int i = 0; i < 5; ++i) add(0.12 + 0.07 * i, -0.12);
  for (int i = 0; i < 4; ++i) add(0, 0.09 * i);
  for (int i = 0; i < 5; ++i) add(-0.1 + 0.05 * i, 0.32);
  for (const double x : {-0.22, 0.22}) {
    for (int i = 0; i < 6; ++i)
      add(x + 0.07 * std::cos(CV_PI * i / 3), 0.03 * std::sin(CV_PI * i / 3));
  }
  for (int i = 0; i < 20; ++i)
    add(0.18 * std::cos(CV_PI * i / 6), 0.5 + 0.06 * std::sin(CV_PI * i / 6));
  return points;
}

TEST(Disguise, ChangesPartOfTheFaceAndLittleElse) {
  const std::vector<cv::Point2d> points = drawn_face({60, 50}, 48);
  const cv::Mat texture(120, 120, CV_8UC1, cv::Scalar(40));
  Rng rng(3);
  int changed_faces = 0;
  for (int i = 0; i < 40; ++i) {
    cv::Mat view(120, 120, CV_8UC1, cv::Scalar(150));
    disguise(view, points, texture, rng);
    const cv::Mat changed = view != 150;
    const int face = cv::countNonZero(changed(cv::Rect(30, 10, 60, 90)));
    changed_faces += face > 50 ? 1 : 0;
    EXPECT_LT(face, 60 * 90) << "something of the face is left";
    // Only held objects may change pixels outside the head's surroundings.
    EXPECT_EQ(cv::countNonZero(changed(cv::Rect(0, 0, 120, 1))) > 60, false);
  }
  EXPECT_GE(changed_faces, 36);
}

TEST(Disguise, IsDeterministicBySeed) {
  const std::vector<cv::Point2d> points = drawn_face({20, 18}, 16);
  const cv::Mat texture(40, 40, CV_8UC1, cv::Scalar(90));
  cv::Mat views[2];
  for (cv::Mat& view : views) {
    view = cv::Mat(40, 40, CV_8UC1, cv::Scalar(128));
    Rng rng(11);
    for (int i = 0; i < 5; ++i) disguise(view, points, texture, rng);
  }
  EXPECT_EQ(cv::norm(views[0], views[1], cv::NORM_INF), 0);
}

// Points far outside the view, all in one place, or mirrored: no access outside the image.
TEST(Disguise, AcceptsExtremePoints) {
  const cv::Mat texture(40, 40, CV_8UC1, cv::Scalar(90));
  std::vector<cv::Point2d> mirrored = drawn_face({20, 18}, 16);
  for (cv::Point2d& p : mirrored) p.x = 40 - p.x;
  Rng rng(5);
  for (const auto& points :
       {drawn_face({-90, 500}, 30), std::vector<cv::Point2d>(68, cv::Point2d(7, 7)), mirrored,
        drawn_face({20, 20}, 4000)}) {
    cv::Mat view(40, 40, CV_8UC1, cv::Scalar(128));
    for (int i = 0; i < 30; ++i) disguise(view, points, texture, rng);
    EXPECT_EQ(view.size(), cv::Size(40, 40));
  }
}

}  // namespace
}  // namespace tarsier::face::training
