// SPDX-License-Identifier: MIT
#include "tarsier/mqtt/hub.h"

#include "tarsier/core/rng.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/mqtt/hub_postgres.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

namespace tarsier::mqtt {
namespace {

using ::testing::ElementsAre;

const std::string kBox = "0123456789abcdef";

class HubTest : public FolderTest {
 protected:
  std::unique_ptr<HubLog> open() const { return open_hub_log(path("events.db")); }
  static HubLog::Received event(const std::string& node, std::int64_t seq, std::int64_t oldest = 1,
                                const std::string& box = kBox) {
    return {node, {box, seq, oldest, "{\"n\":" + std::to_string(seq) + "}"}};
  }
};

TEST_F(HubTest, EventsAreStoredOnce) {
  const auto log = open();
  EXPECT_THAT(log->store({event("a", 1), event("a", 1), event("b", 1)}, 5),
              ElementsAre(true, false, true));
  EXPECT_THAT(log->store({event("a", 1)}, 6), ElementsAre(false));
  EXPECT_EQ(log->count(), 2);
}

TEST_F(HubTest, TheMarkStopsAtAGap) {
  const auto log = open();
  log->store({event("a", 1), event("a", 2), event("a", 4), event("a", 5)}, 5);
  EXPECT_EQ(log->mark("a", kBox), 2);
  log->store({event("a", 3)}, 6);
  EXPECT_EQ(log->mark("a", kBox), 5);
  EXPECT_EQ(log->mark("b", kBox), 0);
}

TEST_F(HubTest, TheMarkSkipsEventsThatTheNodeDropped) {
  const auto log = open();
  log->store({event("a", 100, 90)}, 5);
  EXPECT_EQ(log->mark("a", kBox), 89);
  log->store({event("a", 90, 90)}, 5);
  EXPECT_EQ(log->mark("a", kBox), 90);
  log->store({event("a", 90, 3)}, 5);  // an old message again
  EXPECT_EQ(log->mark("a", kBox), 90);
}

TEST_F(HubTest, EachNodeHasTheMarkOfItsLatestOutbox) {
  const std::string other = "fedcba9876543210";
  {
    const auto log = open();
    log->store({event("a", 1), event("a", 2), event("b", 1)}, 5);
    log->store({event("a", 1, 1, other)}, 6);
  }
  const auto log = open();
  const auto marks = log->marks();
  ASSERT_EQ(marks.size(), 2U);
  EXPECT_EQ(marks[0].first, "a");
  EXPECT_EQ(marks[0].second.outbox, other);
  EXPECT_EQ(marks[0].second.seq, 1);
  EXPECT_EQ(marks[1].second.outbox, kBox);
}

TEST_F(HubTest, StoresEveryEventDespiteReorderingAndLoss) {
  const auto log = open();
  Rng rng(3);
  std::int64_t mark = 0;
  const std::int64_t last = 200;
  while (mark < last) {
    std::vector<HubLog::Received> batch;
    for (int k = 0; k < 20; ++k) {
      const auto seq = rng.integer(static_cast<int>(mark) + 1, static_cast<int>(last));
      batch.push_back(event("a", seq, mark + 1));
    }
    batch.push_back(event("a", mark + 1, mark + 1));
    log->store(batch, 5);
    mark = log->mark("a", kBox);
  }
  EXPECT_EQ(log->count(), last);
  std::set<std::string> events;
  log->read(
      [&](const std::string&, const std::string& text) { return events.insert(text).second; });
  EXPECT_EQ(events.size(), static_cast<std::size_t>(last));
}

TEST_F(HubTest, PostgresAddressesAreRecognised) {
  EXPECT_TRUE(is_postgres("postgresql://host/events"));
  EXPECT_TRUE(is_postgres("postgres://host/events"));
  EXPECT_FALSE(is_postgres("postgresql.db"));
  EXPECT_FALSE(is_postgres("./postgresql://host"));
  std::string reason;
  if (libpq_version(reason).empty()) GTEST_SKIP() << reason;
  try {
    (void)open_hub_log("postgresql://me:secret@127.0.0.1:1/events");
    FAIL() << "nothing listens there";
  } catch (const OutputError& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("postgresql://***@127.0.0.1:1/events: "));
    EXPECT_THAT(error.what(), ::testing::Not(::testing::HasSubstr("secret")));
  }
}

TEST_F(HubTest, NodeNamesAreParsedFromTopics) {
  EXPECT_EQ(node_of("tarsier/gate/events", "tarsier"), "gate");
  EXPECT_EQ(node_of("a/b/gate/events", "a/b"), "gate");
  for (const char* topic : {"tarsier/gate/state", "tarsier/events", "tarsier//events",
                            "tarsier/a/b/events", "other/gate/events", "tarsier/a b/events"}) {
    EXPECT_EQ(node_of(topic, "tarsier"), "") << topic;
  }
}

}  // namespace
}  // namespace tarsier::mqtt
