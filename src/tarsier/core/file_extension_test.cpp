// SPDX-License-Identifier: MIT
#include "tarsier/core/file_extension.h"

#include <gtest/gtest.h>

namespace tarsier {
namespace {

TEST(LowercaseExtension, IsThatOfTheFileName) {
  EXPECT_EQ(lowercase_extension("a.b/IMG_1.JPG"), ".jpg");
  EXPECT_EQ(lowercase_extension("x.tar.GZ"), ".gz");
  EXPECT_EQ(lowercase_extension("folder.png/name"), "");
  EXPECT_EQ(lowercase_extension(".hidden"), "");
  EXPECT_EQ(lowercase_extension("name."), ".");
  EXPECT_EQ(lowercase_extension(""), "");
  EXPECT_EQ(lowercase_extension("b.\xC3\x84X"), ".\xC3\x84x");  // only A..Z
}

}  // namespace
}  // namespace tarsier
