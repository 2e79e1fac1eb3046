// SPDX-License-Identifier: MIT
#include "tarsier/sfm/bundle/local_damping.h"

#include <gtest/gtest.h>

#include <vector>

namespace tarsier::sfm {
namespace {

TEST(LocalDamping, OnlyVariablesThatRaiseTheCostAreDamped) {
  LocalDamping damping(100);
  std::vector<double> rises(100, -1);
  rises[7] = 10;
  rises[8] = 0.1;  // within the tenth that is ignored
  ASSERT_TRUE(damping.raise(rises));
  EXPECT_GT(damping.of(7), 0);
  EXPECT_EQ(damping.of(8), 0);
  EXPECT_EQ(damping.of(0), 0);
}

TEST(LocalDamping, GrowsUntilTheVariableHardlyMovesAndIsLoweredBySuccess) {
  LocalDamping damping(100);
  std::vector<double> rises(100, 0);
  rises[3] = 1;
  double last = 0;
  while (damping.raise(rises)) {
    ASSERT_GT(damping.of(3), last);
    last = damping.of(3);
  }
  EXPECT_GE(last, 1);
  EXPECT_LE(last, 10);
  damping.lower();
  EXPECT_LT(damping.of(3), last);
  EXPECT_TRUE(damping.raise(rises));
}

TEST(LocalDamping, ManyVariablesAreNotDampedOneByOne) {
  LocalDamping damping(100);
  EXPECT_FALSE(damping.raise(std::vector<double>(100, 1)));
  EXPECT_FALSE(damping.raise(std::vector<double>(100, -1)));
  for (int v = 0; v < 100; ++v) EXPECT_EQ(damping.of(v), 0);
}

}  // namespace
}  // namespace tarsier::sfm
