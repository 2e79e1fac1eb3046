// SPDX-License-Identifier: MIT
#include "tarsier/core/file_ending.h"

#include <gtest/gtest.h>

namespace tarsier {
namespace {

TEST(LowerEnding, IsThatOfTheFileName) {
  EXPECT_EQ(lower_ending("a.b/IMG_1.JPG"), ".jpg");
  EXPECT_EQ(lower_ending("x.tar.GZ"), ".gz");
  EXPECT_EQ(lower_ending("folder.png/name"), "");
  EXPECT_EQ(lower_ending(".hidden"), "");
  EXPECT_EQ(lower_ending("name."), ".");
  EXPECT_EQ(lower_ending(""), "");
  EXPECT_EQ(lower_ending("b.\xC3\x84X"), ".\xC3\x84x");  // only A..Z
}

}  // namespace
}  // namespace tarsier
