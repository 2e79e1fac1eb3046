// SPDX-License-Identifier: MIT
#include "tarsier/image/draw/plot.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

namespace tarsier::image::draw {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

int pixels_of(const cv::Mat& image, const cv::Scalar& color) {
  cv::Mat mask;
  cv::inRange(image, color, color, mask);
  return cv::countNonZero(mask);
}

Plot straight_line() {
  Plot plot;
  plot.title = "A < B & C";
  plot.x.label = "time (s)";
  plot.y.label = "error (px)";
  plot.series.push_back(
      {.name = "first", .x = {0, 10}, .y = {0, 1}, .color = cv::Scalar(0, 0, 255)});
  return plot;
}

TEST(Plot, TheLineGoesFromCornerToCorner) {
  const cv::Mat image = plot_image(straight_line(), {600, 400});
  ASSERT_EQ(image.size(), cv::Size(600, 400));
  ASSERT_EQ(image.type(), CV_8UC3);
  cv::Mat mask;
  cv::inRange(image, cv::Scalar(0, 0, 200), cv::Scalar(90, 90, 255), mask);
  std::vector<cv::Point> red;
  cv::findNonZero(mask, red);
  ASSERT_GT(red.size(), 300U);
  int left = 600;
  int right = 0;
  for (const cv::Point& p : red) {
    left = std::min(left, p.x);
    right = std::max(right, p.x);
  }
  EXPECT_LT(left, 100);
  EXPECT_GT(right, 560);
}

TEST(Plot, SvgHasTheWordsEscapedAndTicksAtRoundNumbers) {
  const std::string svg = plot_svg(straight_line());
  EXPECT_THAT(svg, HasSubstr("A &lt; B &amp; C"));
  EXPECT_THAT(svg, HasSubstr(">first</text>"));
  EXPECT_THAT(svg, HasSubstr(">0.2</text>"));
  EXPECT_THAT(svg, HasSubstr(">10</text>"));
  EXPECT_THAT(svg, HasSubstr("#ff0000"));
  EXPECT_THAT(svg, Not(HasSubstr("nan")));
}

TEST(Plot, NonFinitePointsBreakTheLine) {
  Plot plot;
  plot.series.push_back({
      .name = "",
      .x = {0, 1, 2, 3, 4},
      .y = {1, 2, kNaN, 2, 1},
  });
  const std::string svg = plot_svg(plot);
  std::size_t lines = 0;
  for (std::size_t at = svg.find("stroke-width=\"1.85"); at != std::string::npos;
       at = svg.find("stroke-width=\"1.85", at + 1))
    ++lines;
  EXPECT_EQ(lines, 2U);
  EXPECT_THAT(svg, Not(HasSubstr("nan")));
}

TEST(Plot, LogarithmicAxisSkipsValuesThatAreNotPositive) {
  Plot plot;
  plot.x.logarithmic = true;
  plot.y.logarithmic = true;
  plot.series.push_back({
      .name = "s",
      .x = {0, 1, 10, 1000},
      .y = {1, 0.001, 0.1, 1},
  });
  const std::string svg = plot_svg(plot);
  EXPECT_THAT(svg, HasSubstr(">1000</text>"));
  EXPECT_THAT(svg, HasSubstr(">0.01</text>"));
  EXPECT_THAT(svg, Not(HasSubstr("inf")));
}

TEST(Plot, ErrorBarsAreInsideTheAxis) {
  Plot plot;
  plot.series.push_back({.name = "m",
                         .x = {1, 2},
                         .y = {5, 6},
                         .low = {4, 1.2},
                         .high = {6, 9.7},
                         .color = cv::Scalar(255, 0, 0),
                         .line = false,
                         .markers = true});
  const std::string svg = plot_svg(plot);
  EXPECT_THAT(svg, HasSubstr(">10</text>"));
  EXPECT_GT(pixels_of(plot_image(plot), {255, 0, 0}), 40);
}

TEST(Plot, HandlesExtremeValues) {
  for (const double value : {0.0, 1e-300, -1e300, 1e300, 5.0}) {
    Plot plot;
    plot.series.push_back(
        {.name = "s", .x = {value}, .y = {value}, .dashed = true, .markers = true});
    EXPECT_THAT(plot_svg(plot), Not(HasSubstr("nan"))) << value;
    (void)plot_image(plot);
  }
  Plot wide;
  wide.series.push_back({.name = "s", .x = {-1e308, 1e308}, .y = {-1e308, 1e308}, .dashed = true});
  EXPECT_THAT(plot_svg(wide), Not(HasSubstr("nan")));
  Plot zoomed = straight_line();
  zoomed.x.low = 4.9999;
  zoomed.x.high = 5.0001;
  zoomed.series[0].dashed = true;
  (void)plot_image(zoomed);
  EXPECT_EQ(plot_image(Plot{}).size(), cv::Size(800, 500));
}

TEST(Plot, RefusesUnequalSeriesAndImpossibleAxes) {
  Plot unequal;
  unequal.series.push_back({
      .name = "s",
      .x = {1, 2},
      .y = {1},
  });
  EXPECT_THROW((void)plot_svg(unequal), std::invalid_argument);
  Plot backwards = straight_line();
  backwards.x.low = 3;
  backwards.x.high = 1;
  EXPECT_THROW((void)plot_svg(backwards), std::invalid_argument);
  Plot zero = straight_line();
  zero.y.logarithmic = true;
  zero.y.low = 0;
  EXPECT_THROW((void)plot_image(zero), std::invalid_argument);
  EXPECT_THROW((void)plot_image(straight_line(), {10, 10}), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::image::draw
