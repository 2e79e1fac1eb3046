// SPDX-License-Identifier: MIT
#include "tarsier/planar/calibration/board.h"

#include "tarsier/core/errors.h"
#include "tarsier/planar/calibration/coverage.h"
#include "tarsier/synth/boards.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tarsier::planar::calibration {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

std::string refusal(const std::string& text) {
  try {
    (void)parse_board(text, 0.025);
  } catch (const UsageError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(BoardSpecTest, IsParsedAndFormatted) {
  for (const char* text : {"chess:9x6", "charuco:5x7:6x6_250", "charuco:8x5:4x4_50:0.6",
                           "circles:4x11", "circles-grid:7x6", "circles-grid:7x6:0.4"}) {
    const BoardSpec spec = parse_board(text, 0.03);
    EXPECT_EQ(spec.text(), text);
    EXPECT_EQ(spec.pitch, 0.03);
    EXPECT_NO_THROW(spec.check());
  }
  EXPECT_EQ(parse_board("charuco:5x7:36h11", 1).family, "36h11");
}

TEST(BoardSpecTest, RejectsInvalidText) {
  EXPECT_THAT(refusal("chess"), HasSubstr("no size"));
  EXPECT_THAT(refusal("chess:9"), HasSubstr("'9' is not a size"));
  EXPECT_THAT(refusal("chess:9x"), HasSubstr("is not a size"));
  EXPECT_THAT(refusal("chess:9x6x2"), HasSubstr("is not a size"));
  EXPECT_THAT(refusal("chess:9x6:1"), HasSubstr("too long"));
  EXPECT_THAT(refusal("chess:2x6"), HasSubstr("3..100"));
  EXPECT_THAT(refusal("chess:9x999999999999"), HasSubstr("is not a size"));
  EXPECT_THAT(refusal("checker:9x6"), HasSubstr("no such kind"));
  EXPECT_THAT(refusal("charuco:5x7"), HasSubstr("family"));
  EXPECT_THAT(refusal("charuco:5x7:9x9_1"), HasSubstr("9x9_1"));
  EXPECT_THAT(refusal("charuco:20x20:4x4_50"), HasSubstr("200 markers are needed"));
  EXPECT_THAT(refusal("charuco:5x7:6x6_250:1.5"), HasSubstr("last number"));
  EXPECT_THAT(refusal("circles:4x11:nan"), HasSubstr("last number"));
  EXPECT_THAT(refusal(""), HasSubstr("no such kind"));
}

TEST(BoardSpecTest, PointsLieWhereTheyArePrinted) {
  const BoardSpec chess = parse_board("chess:9x6", 0.02);
  EXPECT_EQ(chess.points(), 54);
  EXPECT_EQ(chess.point(0), cv::Point2d(0, 0));
  EXPECT_EQ(chess.point(10), cv::Point2d(0.02, 0.02));
  const BoardSpec charuco = parse_board("charuco:5x7:6x6_250", 0.5);
  EXPECT_EQ(charuco.points(), 24);
  EXPECT_EQ(charuco.point(5), cv::Point2d(0.5, 0.5));
  EXPECT_EQ(marker_squares(charuco).size(), 17U);
  EXPECT_EQ(marker_squares(charuco)[2], cv::Point(0, 1));
  const BoardSpec dots = parse_board("circles:4x11", 1);
  EXPECT_EQ(dots.points(), 44);
  EXPECT_EQ(dots.point(1), cv::Point2d(2, 0));
  EXPECT_EQ(dots.point(4), cv::Point2d(1, 1));
  EXPECT_THROW((void)dots.point(44), std::invalid_argument);
}

TEST(CoverageTest, ReportsMissingRegionsAndTilts) {
  const BoardSpec spec = parse_board("chess:9x6", 0.025);
  const geometry::Camera camera{640, 480, 600, 600, 319.5, 239.5};
  const auto view = [&](cv::Point2d at, Eigen::Vector3d angles) {
    return synth::exact_view(camera, synth::board_pose(camera, spec, at, angles, 0.5), spec);
  };
  Coverage coverage = coverage_of({view({0.2, 0.2}, {0, 0, 0})}, spec, {640, 480});
  EXPECT_EQ(coverage.views, 1);
  EXPECT_THAT(coverage.missing(), Contains("the bottom right of the image"));
  EXPECT_THAT(coverage.missing(), Contains("the board, left edge closer"));
  EXPECT_THAT(coverage.missing(), Not(Contains("the top left of the image")));
  // The same view again gives no new coverage; another position or tilt does.
  EXPECT_EQ(coverage.gain(view({0.2, 0.2}, {0, 0, 0}), spec), 0);
  EXPECT_GT(coverage.gain(view({0.8, 0.8}, {0, 0, 0}), spec), 0.2);
  EXPECT_GT(coverage.gain(view({0.2, 0.2}, {30, 0, 0}), spec), 0.2);
  EXPECT_EQ(coverage.gain({}, spec), 0);
  for (const double x : {0.2, 0.5, 0.8})
    for (const double y : {0.2, 0.5, 0.8})
      coverage.add(view({x, y}, {x < 0.4   ? 25.0
                                 : x > 0.6 ? -25.0
                                           : 0.0,
                                 y < 0.4   ? 25.0
                                 : y > 0.6 ? -25.0
                                           : 0.0,
                                 0}),
                   spec);
  EXPECT_TRUE(coverage.missing().empty()) << coverage.missing()[0];
}

TEST(CoverageTest, ReportsNearerEdge) {
  const BoardSpec spec = parse_board("chess:9x6", 0.025);
  const geometry::Camera camera{640, 480, 704, 704, 319.5, 239.5};
  for (const double angle : {-30.0, 30.0}) {
    const geometry::Rigid3 pose = synth::board_pose(camera, spec, {0.5, 0.5}, {angle, 0, 0}, 0.6);
    const auto depth = [&](double x) { return (pose * Eigen::Vector3d(x, 0, 0))[2]; };
    const cv::Point2d tilt = tilt_of(synth::exact_view(camera, pose, spec), spec, {640, 480});
    EXPECT_NEAR(std::abs(tilt.x), 30, 1);
    EXPECT_EQ(tilt.x > 0, depth(0.2) < depth(0));  // the right edge is nearer
    EXPECT_NEAR(tilt.y, 0, 1);
  }
}

}  // namespace
}  // namespace tarsier::planar::calibration
