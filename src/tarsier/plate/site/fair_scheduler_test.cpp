// SPDX-License-Identifier: MIT
#include "tarsier/plate/site/fair_scheduler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace tarsier::plate {
namespace {

using testing::Each;
using testing::Optional;

TEST(FairScheduler, SharesTheCostEqually) {
  FairScheduler scheduler(3);
  const std::vector<double> costs{0.01, 0.02, 0.06};  // s per request
  std::vector<double> spent(3);
  for (std::size_t i = 0; i < 3; ++i) scheduler.offer(i, false);
  for (int k = 0; k < 900; ++k) {
    const auto camera = scheduler.take();
    ASSERT_TRUE(camera);
    scheduler.done(*camera, costs[*camera]);
    spent[*camera] += costs[*camera];
    scheduler.offer(*camera, false);
  }
  EXPECT_THAT(spent, Each(testing::DoubleNear(5.4, 0.12)));
}

TEST(FairScheduler, IdleCamerasGainNoCredit) {
  FairScheduler scheduler(2);
  for (int k = 0; k < 100; ++k) {
    scheduler.offer(0, false);
    ASSERT_THAT(scheduler.take(), Optional(0U));
    scheduler.done(0, 0.02);
  }
  int second = 0;
  for (int k = 0; k < 20; ++k) {
    scheduler.offer(0, false);
    scheduler.offer(1, false);
    const auto camera = scheduler.take();
    second += camera == 1U ? 1 : 0;
    scheduler.done(*camera, 0.02);
  }
  EXPECT_NEAR(second, 10, 1);
}

TEST(FairScheduler, LowPriorityRequestsAreServedLast) {
  FairScheduler scheduler(3);
  scheduler.offer(0, true);
  scheduler.offer(1, false);
  scheduler.offer(2, false);
  EXPECT_THAT(scheduler.take(), Optional(1U));
  scheduler.done(1, 5);
  scheduler.offer(1, false);
  EXPECT_THAT(scheduler.take(), Optional(2U));
  EXPECT_THAT(scheduler.take(), Optional(1U));
  EXPECT_THAT(scheduler.take(), Optional(0U));
  EXPECT_EQ(scheduler.take(), std::nullopt);
}

TEST(FairScheduler, ACameraIsServedOnceAtATime) {
  FairScheduler scheduler(2);
  scheduler.offer(0, false);
  EXPECT_THAT(scheduler.take(), Optional(0U));
  scheduler.offer(0, false);
  EXPECT_EQ(scheduler.take(), std::nullopt);
  scheduler.done(0, 1);
  EXPECT_THAT(scheduler.take(), Optional(0U));
  EXPECT_THROW(scheduler.done(1, 1), std::invalid_argument);
}

TEST(FairScheduler, LowPriorityRequestDoesNotDemoteAPendingOne) {
  FairScheduler scheduler(2);
  scheduler.offer(0, true);
  scheduler.offer(1, false);
  scheduler.offer(1, true);
  EXPECT_THAT(scheduler.take(), Optional(1U));
}

}  // namespace
}  // namespace tarsier::plate
