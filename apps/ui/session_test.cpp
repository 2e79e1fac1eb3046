// SPDX-License-Identifier: MIT
#include "ui/session.h"

#include <gtest/gtest.h>

namespace tarsier {
namespace {

const std::vector<Action> kActions{{"zoom", "nearer", '+'},         {"mirror", "mirrored", 'm'},
                                   {"next", "the next", 'n'},       {"hide", "hide it", 'h'},
                                   {"help", "show this list", '?'}, {"quit", "end", 0}};

TEST(ActionOf, IgnoresShiftAndCapsLock) {
  EXPECT_EQ(action_of(key_event('m'), kActions), "mirror");
  EXPECT_EQ(action_of(key_event('M'), kActions), "mirror");
  EXPECT_EQ(action_of(key_event('='), kActions), "zoom");
  EXPECT_EQ(action_of(key_event('h'), kActions), "hide");
  Event event = key_event('m');
  event.control = true;
  EXPECT_EQ(action_of(event, kActions), "");
  EXPECT_EQ(action_of(action_event("anything"), kActions), "anything");
  EXPECT_EQ(action_of(slider_event("m", 1), kActions), "");
}

TEST(ActionOf, MapsTheCommonKeys) {
  for (const int key : {key::kEscape, static_cast<int>('q'), static_cast<int>('Q')})
    EXPECT_EQ(action_of(key_event(key), kActions), "quit");
  for (const int key : {key::kRight, key::kSpace, key::kEnter})
    EXPECT_EQ(action_of(key_event(key), kActions), "next");
  EXPECT_EQ(action_of(key_event('?'), kActions), "help");
  EXPECT_EQ(action_of(key_event('h'), {{"help", "show this list", 0}}), "help");
}

TEST(ActionOf, IsEmptyForUnknownKeys) {
  EXPECT_EQ(action_of(key_event(key::kLeft), kActions), "");
  EXPECT_EQ(action_of(key_event('x'), kActions), "");
  EXPECT_EQ(action_of(key_event(0), kActions), "");
  EXPECT_EQ(action_of(key_event('?'), {}), "");
}

}  // namespace
}  // namespace tarsier
