// SPDX-License-Identifier: MIT
#include "ui/face/presence.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>
#include <string>

namespace tarsier {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

std::vector<std::string> words(const std::vector<PresenceChange>& changes) {
  std::vector<std::string> words;
  for (const PresenceChange& change : changes)
    words.push_back((change.appeared ? "+" : "-") + std::to_string(change.id) + change.source);
  return words;
}

TEST(PresenceTest, ShortGapIsNoLoss) {
  Presence presence(1);
  EXPECT_THAT(words(presence.step("a", 0, {7, 7, 3})), ElementsAre("+7a", "+3a"));
  EXPECT_THAT(presence.step("a", 0.5, {3}), IsEmpty());
  EXPECT_THAT(presence.step("a", 0.9, {7, 3}), IsEmpty());
  EXPECT_THAT(presence.step("a", 1.9, {3}), IsEmpty());
  const std::vector<PresenceChange> lost = presence.step("a", 2, {3});
  EXPECT_THAT(words(lost), ElementsAre("-7a"));
  EXPECT_DOUBLE_EQ(lost[0].first_time, 0);
  EXPECT_DOUBLE_EQ(lost[0].last_time, 0.9);
  EXPECT_THAT(words(presence.step("a", 2.1, {7, 3})), ElementsAre("+7a"));
  EXPECT_THAT(words(presence.finish()), ElementsAre("-3a", "-7a"));
  EXPECT_THAT(presence.finish(), IsEmpty());
}

TEST(PresenceTest, ChangeOfSourceEndsAllPresences) {
  Presence presence(1);
  EXPECT_THAT(words(presence.step("a", 0, {7})), ElementsAre("+7a"));
  EXPECT_THAT(words(presence.step("b", 0.1, {7})), ElementsAre("-7a", "+7b"));
  EXPECT_THAT(words(presence.step("b", 0.0, {7})), ElementsAre("-7b", "+7b")) << "from its start";
}

TEST(PresenceTest, RefusesInvalidTimes) {
  EXPECT_THROW(Presence(-1), std::invalid_argument);
  EXPECT_THROW(Presence(std::numeric_limits<double>::infinity()), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier
