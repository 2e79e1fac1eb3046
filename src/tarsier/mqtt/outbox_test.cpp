// SPDX-License-Identifier: MIT
#include "tarsier/mqtt/outbox.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/mqtt/publisher.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

namespace tarsier::mqtt {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::int64_t kMaxEntries = 1000;

std::vector<std::string> entries_after(Outbox& outbox, std::int64_t number) {
  std::vector<std::string> found;
  outbox.read(number, [&](std::int64_t seq, const std::string& payload) {
    found.push_back(std::to_string(seq) + payload);
    return true;
  });
  return found;
}

class OutboxTest : public FolderTest {};

TEST_F(OutboxTest, NumbersAreNeverReused) {
  std::string id;
  {
    Outbox outbox(path("outbox.db"));
    id = outbox.id();
    EXPECT_EQ(outbox.last(), 0);
    EXPECT_EQ(outbox.first(), 1);
    EXPECT_EQ(outbox.add("a", kMaxEntries), 1);
    EXPECT_EQ(outbox.add("b", kMaxEntries), 2);
    EXPECT_THAT(entries_after(outbox, 1), ElementsAre("2b"));
    EXPECT_EQ(outbox.forget(2), 2);
    EXPECT_THAT(entries_after(outbox, 0), IsEmpty());
  }
  Outbox outbox(path("outbox.db"));
  EXPECT_EQ(outbox.id(), id);
  EXPECT_EQ(outbox.last(), 2);
  EXPECT_EQ(outbox.first(), 3);
  EXPECT_EQ(outbox.add("c", kMaxEntries), 3);
  EXPECT_NE(Outbox(path("other.db")).id(), id);
}

TEST_F(OutboxTest, DropsTheOldestEntriesBeyondTheLimit) {
  Outbox outbox(path("outbox.db"));
  for (int k = 1; k <= 10; ++k) outbox.add("x", 3);
  EXPECT_EQ(outbox.count(), 3);
  EXPECT_EQ(outbox.first(), 8);
}

TEST_F(OutboxTest, OtherFilesAreRefused) {
  std::ofstream(path("noise.db")) << std::string(5000, 'x');
  EXPECT_THROW(Outbox{path("noise.db")}, OutputError);
  EXPECT_THROW(Outbox{path("missing/outbox.db")}, OutputError);
}

TEST(MessageTest, RoundTrip) {
  const EventMessage message{"0123456789abcdef", 7, 3, R"({"text":"1234BCD","a":[1,2]})"};
  const auto read = parse_event_message(event_message_text(message));
  ASSERT_TRUE(read);
  EXPECT_EQ(read->outbox, message.outbox);
  EXPECT_EQ(read->seq, 7);
  EXPECT_EQ(read->oldest, 3);
  EXPECT_EQ(read->event, message.event);
  const auto mark = parse_mark(mark_text({"0123456789abcdef", 12}));
  ASSERT_TRUE(mark);
  EXPECT_EQ(mark->seq, 12);
}

TEST(MessageTest, InvalidMessagesAreIgnored) {
  const std::string id = R"("outbox":"0123456789abcdef")";
  for (const std::string& text :
       {std::string(), std::string("x"), std::string("[]"), std::string("{}"),
        "{" + id + R"(,"seq":0,"oldest":0,"event":{}})",
        "{" + id + R"(,"seq":1,"oldest":2,"event":{}})",
        "{" + id + R"(,"seq":1.5,"oldest":1,"event":{}})", "{" + id + R"(,"seq":1,"oldest":1})",
        "{" + id + R"(,"seq":1,"oldest":1,"event":[]})",
        "{" + id + R"(,"seq":-1,"oldest":-1,"event":{}})",
        "{" + id + R"(,"seq":18446744073709551615,"oldest":1,"event":{}})",
        "{" + id + R"(,"seq":9007199254740993,"oldest":1,"event":{}})",
        std::string(R"({"outbox":"0123","seq":1,"oldest":1,"event":{}})"),
        std::string(R"({"outbox":7,"seq":1,"oldest":1,"event":{}})")}) {
    EXPECT_FALSE(parse_event_message(text)) << text;
  }
  EXPECT_FALSE(parse_mark("{" + id + "}"));
  EXPECT_FALSE(parse_mark("{" + id + R"(,"seq":"1"})"));
  EXPECT_FALSE(parse_mark(std::string(10, '[')));
}

TEST(MessageTest, InvalidUtf8DoesNotThrow) {
  const auto read = parse_event_message(
      "{\"outbox\":\"0123456789abcdef\",\"seq\":1,\"oldest\":1,\"event\":{\"a\":\"\xFF\"}}");
  EXPECT_TRUE(!read || !read->event.empty());
}

TEST(PublisherTest, TheDefaultOutboxIsInTheStateFolder) {
  const char* old_value = std::getenv("XDG_STATE_HOME");
  const std::string before = old_value == nullptr ? "" : old_value;
  ::setenv("XDG_STATE_HOME", "/state", 1);
  EXPECT_EQ(default_outbox("tarsier/gate-1"), "/state/tarsier/outbox-tarsier-gate-1.db");
  if (before.empty()) {
    ::unsetenv("XDG_STATE_HOME");
  } else {
    ::setenv("XDG_STATE_HOME", before.c_str(), 1);
  }
}

}  // namespace
}  // namespace tarsier::mqtt
