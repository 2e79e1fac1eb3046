// SPDX-License-Identifier: MIT
#include "tarsier/planar/sheets/sheet.h"

#include "tarsier/core/errors.h"
#include "tarsier/planar/calibration/detect.h"
#include "tarsier/planar/markers/predefined.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <map>
#include <numeric>

namespace tarsier::planar::sheets {
namespace {

using calibration::parse_board;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

template <typename Call>
std::string refusal(const Call& call) {
  try {
    (void)call();
  } catch (const UsageError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(ParseTest, Papers) {
  EXPECT_EQ(parse_paper("a4"), cv::Size2d(210, 297));
  EXPECT_EQ(parse_paper("letter").width, 215.9);
  EXPECT_EQ(parse_paper("200x300.5mm"), cv::Size2d(200, 300.5));
  for (const char* text :
       {"", "a9", "200x300", "200mm", "x300mm", "1x1mm", "9999x10mm", "nanx50mm"})
    EXPECT_THAT(refusal([&] { return parse_paper(text); }), HasSubstr("letter")) << text;
}

TEST(ParseTest, Ids) {
  EXPECT_THAT(parse_ids("0-3", "6x6_250"), ElementsAre(0, 1, 2, 3));
  EXPECT_THAT(parse_ids("9,1-3,2", "6x6_250"), ElementsAre(9, 1, 2, 3));
  EXPECT_THAT(refusal([] { return parse_ids("0-250", "6x6_250"); }), HasSubstr("0..249"));
  for (const char* text : {"", ",", "1-", "-1", "3-1", "a", "1,,2", "1-2-3", "99999999999"})
    EXPECT_THAT(refusal([&] { return parse_ids(text, "6x6_250"); }), HasSubstr("option 'ids'"))
        << text;
  EXPECT_THAT(refusal([] { return parse_ids("0", "7x9"); }), HasSubstr("7x9"));
}

// The rendered page decodes, and the markers have the requested position and size.
TEST(MarkerSheetTest, MarkersAreTrueToScaleAndReadable) {
  for (const char* family : {"aruco-original", "6x6_250", "36h11"}) {
    const double side = 50;
    const std::vector<int> ids = parse_ids("0-7,20", family);
    const auto pages = marker_pages(family, ids, side, {});
    ASSERT_EQ(pages.size(), 2U) << family;  // 2 x 4 on the first
    std::map<int, int> seen;
    constexpr double kDpi = 254;  // 10 px a mm
    for (const Page& page : pages) {
      EXPECT_EQ(page.size, cv::Size2d(210, 297));
      const cv::Mat image = raster_of(page, kDpi);
      cv::Mat blurred;  // as in a camera image
      cv::GaussianBlur(image, blurred, {}, 1.5);
      for (const markers::Marker& found : markers::detect_with_opencv(blurred, family)) {
        ++seen[found.id];
        for (std::size_t k = 0; k < 4; ++k) {
          const double edge = (found.corners[(k + 1) % 4] - found.corners[k]).norm();
          EXPECT_NEAR(edge / 10, side, 0.1);
        }
        EXPECT_LT(found.corners[0].x(), found.corners[1].x());  // upright
        EXPECT_LT(found.corners[0].y(), found.corners[2].y());
      }
      // Nothing within the margins.
      const cv::Rect inner(98, 98, image.cols - 196, image.rows - 196);
      cv::Mat outside = image.clone();
      outside(inner).setTo(255);
      EXPECT_EQ(cv::countNonZero(outside < 255), 0) << family;
    }
    EXPECT_EQ(seen.size(), ids.size()) << family;
    for (const auto& [id, count] : seen) EXPECT_EQ(count, 1) << family << " " << id;
  }
}

// Printed markers lie where the layout says: all agree with one pose of the board.
TEST(MarkerSheetTest, LayoutIsThatOfThePage) {
  constexpr double kDpi = 254;  // 10 px a mm
  const std::vector<int> ids{4, 9, 2, 7, 11};
  const markers::MarkerBoard board = board_of_page("36h11", ids, 40, {});
  board.check();
  ASSERT_EQ(board.markers.size(), ids.size());
  cv::Mat image = raster_of(marker_pages("36h11", ids, 40, {}).front(), kDpi);
  cv::GaussianBlur(image, image, {}, 1.5);
  const auto found = markers::detect_with_opencv(image, "36h11");
  EXPECT_EQ(found.size(), ids.size());
  const markers::BoardCorners corners = markers::corners_on_board(found, board.markers);
  ASSERT_EQ(corners.on_board.size(), 4 * ids.size());
  for (std::size_t k = 1; k < corners.on_board.size(); ++k) {
    const cv::Point2d on_board = corners.on_board[k] - corners.on_board[0];
    const cv::Point2d seen = corners.pixels[k] - corners.pixels[0];
    EXPECT_NEAR(seen.x, 10000 * on_board.x, 1);
    EXPECT_NEAR(seen.y, -10000 * on_board.y, 1);
  }
  std::vector<int> many(60);
  std::iota(many.begin(), many.end(), 0);
  EXPECT_THAT(refusal([&] { return board_of_page("36h11", many, 40, {}); }),
              HasSubstr("do not fit one page"));
}

TEST(MarkerSheetTest, RulerIsTenCentimetres) {
  const Page page = marker_pages("6x6_250", {0}, 50, {}).front();
  double longest = 0;
  for (const Line& line : page.lines) longest = std::max(longest, cv::norm(line.to - line.from));
  EXPECT_DOUBLE_EQ(longest, 100);
  bool found = false;
  for (const Text& text : page.texts) found = found || text.text.find("10 cm") == 0;
  EXPECT_TRUE(found);
}

TEST(MarkerSheetTest, ErrorNamesSizeThatFits) {
  const std::string text = refusal([] { return marker_pages("6x6_250", {0}, 250, {}); });
  EXPECT_THAT(text, HasSubstr("250 mm"));
  EXPECT_THAT(text, HasSubstr("a side of up to 138 mm"));
  EXPECT_EQ(marker_pages("6x6_250", {0}, 138, {}).size(), 1U);
  EXPECT_THAT(refusal([] { return marker_pages("6x6_250", {0}, 1, {}); }), HasSubstr("no printer"));
  SheetOptions narrow;
  narrow.paper = {50, 50};
  narrow.margin = 30;
  EXPECT_THAT(refusal([&] { return marker_pages("6x6_250", {0}, 5, narrow); }),
              HasSubstr("larger page"));
  EXPECT_THROW((void)marker_pages("6x6_250", {}, 50, {}), std::invalid_argument);
}

// Each board is found on its own rendered page, with its points at the specified positions.
TEST(BoardSheetTest, BoardsAreTrueToScaleAndFound) {
  for (const char* text : {"chess:9x6", "charuco:5x7:6x6_250", "charuco:6x8:36h11:0.7",
                           "circles:4x11", "circles-grid:7x6"}) {
    const auto spec = parse_board(text, 0.018);
    const Page page = board_page(spec, {});
    constexpr double kDpi = 127;  // 5 px a mm
    cv::Mat image = raster_of(page, kDpi);
    cv::GaussianBlur(image, image, {}, 1.0);
    cv::copyMakeBorder(image, image, 40, 40, 40, 40, cv::BORDER_CONSTANT, cv::Scalar(255));
    const auto view = calibration::find_board(image, spec);
    ASSERT_EQ(static_cast<int>(view.points.size()), spec.points()) << text;
    double worst = 0;
    for (std::size_t i = 0; i < view.points.size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        const double px = cv::norm(view.pixels[i] - view.pixels[j]);
        const double mm = 1e3 * cv::norm(spec.point(view.points[i]) - spec.point(view.points[j]));
        worst = std::max(worst, std::abs(px / 5 - mm));
      }
    }
    EXPECT_LT(worst, 0.1) << text;
  }
}

TEST(BoardSheetTest, UsesLandscapeIfNeeded) {
  EXPECT_EQ(board_page(parse_board("chess:9x6", 0.019), {}).size, cv::Size2d(210, 297));
  EXPECT_EQ(board_page(parse_board("chess:9x6", 0.022), {}).size, cv::Size2d(297, 210));
  EXPECT_THAT(refusal([] { return board_page(parse_board("chess:9x6", 0.03), {}); }),
              HasSubstr("a square of up to 25.2 mm"));
}

}  // namespace
}  // namespace tarsier::planar::sheets
