// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/detector.h"

#include "tarsier/planar/markers/testing_marker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tarsier::planar::markers {
namespace {

std::vector<Marker> detect(const cv::Mat& gray, const Dictionary& family) {
  DetectWorkspace workspace;
  return detect_markers(gray, family, {}, workspace);
}

void expect_detected(const cv::Mat& gray, const Dictionary& family,
                     const std::vector<DrawnMarker>& drawn, double within_px) {
  const auto found = detect(gray, family);
  ASSERT_EQ(found.size(), drawn.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_EQ(found[i].id, drawn[i].id);
    EXPECT_LT(rmse(found[i].corners, drawn[i].corners), within_px) << "id " << found[i].id;
  }
}

TEST(Detector, DetectsEveryFamilyInEveryRotation) {
  for (const std::string& name : dictionary_names()) {
    const Dictionary& family = find_dictionary(name);
    cv::Mat gray(240, 480, CV_8UC1, cv::Scalar(130));
    const std::vector<DrawnMarker> drawn{{7, square(90, 110, 80, 20, 0.15)},
                                         {11, square(240, 120, 60, 130)},
                                         {family.size() - 2, square(390, 120, 100, -75, 0.2)}};
    for (const DrawnMarker& marker : drawn) draw_marker(gray, family, marker);
    add_noise(gray, 3, 1);
    SCOPED_TRACE(name);
    expect_detected(gray, family, drawn, 0.12);
  }
}

TEST(Detector, DetectsSmallAndLargeMarkers) {
  const Dictionary& family = find_dictionary("aruco-original");
  for (const double side : {14.0, 18.0, 300.0, 700.0}) {
    cv::Mat gray(1000, 1000, CV_8UC1, cv::Scalar(130));
    const std::vector<DrawnMarker> drawn{{333, square(500.3, 499.6, side, 32)}};
    draw_marker(gray, family, drawn[0]);
    add_noise(gray, 2, 2);
    SCOPED_TRACE(side);
    expect_detected(gray, family, drawn, side < 20 ? 0.3 : 0.1);
  }
}

TEST(Detector, ToleratesGradientsShadowsAndLowLight) {
  const Dictionary& family = find_dictionary("36h11");
  cv::Mat gray(240, 320, CV_8UC1, cv::Scalar(130));
  const std::vector<DrawnMarker> drawn{{5, square(90, 120, 70, 10)}, {6, square(230, 120, 70, 50)}};
  for (const DrawnMarker& marker : drawn) draw_marker(gray, family, marker);
  for (int y = 0; y < gray.rows; ++y) {
    for (int x = 0; x < gray.cols; ++x) {
      // Light decreases to the right, and a soft shadow edge runs across the first marker.
      const double shade = std::clamp((x + y / 2.0 - 135) / 30, 0.0, 1.0);
      const double light = (1 - 0.8 * x / 320.0) * (1 - 0.55 * shade);
      auto& value = gray.at<std::uint8_t>(y, x);
      value = cv::saturate_cast<std::uint8_t>(10 + light * value);
    }
  }
  add_noise(gray, 2, 3);
  expect_detected(gray, family, drawn, 0.4);
}

TEST(Detector, ReadsMotionBlurredMarkers) {
  const Dictionary& family = find_dictionary("36h11");
  cv::Mat gray(120, 160, CV_8UC1, cv::Scalar(90));
  const DrawnMarker drawn{42, square(80, 60, 36, 15)};
  draw_marker(gray, family, drawn);
  cv::Mat blurred;
  cv::blur(gray, blurred, {7, 1});
  add_noise(blurred, 5, 4);
  expect_detected(blurred, family, {drawn}, 0.5);
}

TEST(Detector, CorrectsHiddenCells) {
  const Dictionary& family = find_dictionary("36h11");
  cv::Mat gray(200, 200, CV_8UC1, cv::Scalar(130));
  const DrawnMarker drawn{100, square(100, 100, 120, 0)};
  draw_marker(gray, family, drawn);
  cv::circle(gray, {110, 105}, 14, cv::Scalar(170), cv::FILLED);
  const auto found = detect(gray, family);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].id, 100);
  EXPECT_GT(found[0].errors, 0);
  EXPECT_LT(rmse(found[0].corners, drawn.corners), 0.1);
}

TEST(Detector, DetectsTwoMarkersOfOneId) {
  const Dictionary& family = find_dictionary("6x6_250");
  cv::Mat gray(160, 320, CV_8UC1, cv::Scalar(130));
  const std::vector<DrawnMarker> drawn{{9, square(80, 80, 60, 5)}, {9, square(240, 80, 40, 190)}};
  for (const DrawnMarker& marker : drawn) draw_marker(gray, family, marker);
  EXPECT_EQ(detect(gray, family).size(), 2U);
}

TEST(Detector, HasNoFalseDetections) {
  const Dictionary& family = find_dictionary("36h11");
  cv::Mat gray(240, 320, CV_8UC1, cv::Scalar(130));
  draw_marker(gray, family, {5, square(160, 120, 120, 10)});
  EXPECT_EQ(detect(gray, family).size(), 1U);
  cv::Mat mirrored;
  cv::flip(gray, mirrored, 1);
  EXPECT_TRUE(detect(mirrored, family).empty());
  EXPECT_TRUE(detect(255 - gray, family).empty());
  EXPECT_TRUE(detect(gray, find_dictionary("6x6_250")).empty());

  cv::Mat board(240, 320, CV_8UC1);
  for (int y = 0; y < board.rows; ++y)
    for (int x = 0; x < board.cols; ++x)
      board.at<std::uint8_t>(y, x) = (x / 20 + y / 20) % 2 == 0 ? 20 : 230;
  cv::Mat noise(240, 320, CV_8UC1, cv::Scalar(128));
  add_noise(noise, 60, 5);
  cv::Mat frames(240, 320, CV_8UC1, cv::Scalar(220));  // empty frames and filled squares
  cv::rectangle(frames, {40, 60, 100, 100}, cv::Scalar(20), 14);
  cv::rectangle(frames, {180, 60, 100, 100}, cv::Scalar(20), cv::FILLED);
  for (const std::string& name : dictionary_names()) {
    EXPECT_TRUE(detect(board, find_dictionary(name)).empty()) << name;
    EXPECT_TRUE(detect(noise, find_dictionary(name)).empty()) << name;
    EXPECT_TRUE(detect(frames, find_dictionary(name)).empty()) << name;
  }
}

TEST(Detector, HandlesImageEdgesAndAnyImageSize) {
  const Dictionary& family = find_dictionary("36h11");
  cv::Mat gray(200, 200, CV_8UC1, cv::Scalar(220));
  draw_marker(gray, family, {3, square(34, 100, 60, 0)});
  // A narrow margin of paper.
  EXPECT_EQ(detect(gray(cv::Rect(2, 0, 198, 200)), family).size(), 1U);
  EXPECT_TRUE(detect(gray(cv::Rect(14, 0, 186, 200)), family).empty());  // its frame is cut off
  for (const cv::Size size : {cv::Size(0, 0), cv::Size(1, 1), cv::Size(7, 300), cv::Size(8, 8)})
    EXPECT_TRUE(detect(cv::Mat(size, CV_8UC1, cv::Scalar(0)), family).empty());
  EXPECT_THROW((void)detect(cv::Mat(99, 99, CV_8UC3), family), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::planar::markers
