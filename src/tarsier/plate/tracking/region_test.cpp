// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/region.h"

#include "tarsier/core/errors.h"

#include <gtest/gtest.h>

namespace tarsier::plate {
namespace {

TEST(RegionTest, ParsesBoxesInPixelsAndFractions) {
  const Region pixels = parse_region("100,50,200,100");
  EXPECT_FALSE(pixels.relative);
  EXPECT_TRUE(pixels.contains({150, 60}, {640, 480}));
  EXPECT_FALSE(pixels.contains({99, 60}, {640, 480}));
  EXPECT_FALSE(pixels.contains({150, 151}, {640, 480}));
  const Region shares = parse_region("0.5,0,0.5,1");
  EXPECT_TRUE(shares.relative);
  EXPECT_TRUE(shares.contains({330, 100}, {640, 480}));
  EXPECT_FALSE(shares.contains({310, 100}, {640, 480}));
  EXPECT_EQ(shares.outline({640, 480})[0], cv::Point(320, 0));
  EXPECT_TRUE(Region().contains({1, 1}, {}));
}

TEST(RegionTest, PolygonsMayBeConcave) {
  const Region region = parse_region("0,0 100,0; 100,100 50,20 0,100");
  EXPECT_TRUE(region.contains({10, 50}, {200, 200}));
  EXPECT_TRUE(region.contains({90, 50}, {200, 200}));
  EXPECT_FALSE(region.contains({50, 60}, {200, 200}));
}

TEST(RegionTest, RejectsInvalidRegions) {
  for (const char* text : {"", "1", "1,2", "1,2,3", "1,2,3,4,5", "0,0 1,1", "a,b,c,d", "1,2,nan,4",
                           "-1,2,3,4", "1,2,0,4", "0,0 1,1 2,2", "1,2,3,4 5,6", "1,2,3,4 5,6,7,8",
                           "0,0,1e9,1", "1,,3,4", "1,2,3,"}) {
    EXPECT_THROW((void)parse_region(text), UsageError) << text;
  }
}

}  // namespace
}  // namespace tarsier::plate
