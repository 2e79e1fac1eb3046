// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/log.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/plate/tracking/testing_moment.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>

namespace tarsier::plate {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(TimeTest, ParsesAndFormatsMoments) {
  EXPECT_EQ(moment_text(moment_at("2024-05-01")), "2024-05-01T00:00:00.000Z");
  EXPECT_EQ(moment_text(moment_at("2024-02-29T23:59")), "2024-02-29T23:59:00.000Z");
  EXPECT_EQ(moment_text(moment_at("2024-05-01 12:30:15.25Z")), "2024-05-01T12:30:15.250Z");
  EXPECT_EQ(moment_text(moment_at("2024-05-01T00:30+02:00")), "2024-04-30T22:30:00.000Z");
  EXPECT_EQ(moment_text(moment_at("2024-05-01T00:30-01:30")), "2024-05-01T02:00:00.000Z");
  EXPECT_EQ(moment_text(parse_moment("2024-05-01", {}, true, "until")), "2024-05-01T23:59:59.999Z");
  EXPECT_EQ(parse_moment("2h", moment_at("2024-05-01T12:00"), false, "since"),
            moment_at("2024-05-01T10:00"));
  for (const char* text :
       {"", "now", "2024", "2024-13-01", "2023-02-29", "2024-05-01T", "24-05-01",
        "2024-05-01T24:00", "2024-05-01T12:60", "2024-05-01T12:30:15.", "2024-05-01T12:30Zx",
        "2024-05-01T12:30+2", "1969-12-31", "-2h", "2 h"}) {
    EXPECT_THROW((void)moment_at(text), UsageError) << text;
  }
}

TEST(TimeTest, ParsesAndLimitsDurations) {
  EXPECT_EQ(parse_duration("90s", "keep"), std::chrono::seconds(90));
  EXPECT_EQ(parse_duration("30d", "keep"), std::chrono::hours(720));
  EXPECT_EQ(parse_duration("0m", "keep"), std::chrono::seconds(0));
  EXPECT_EQ(parse_duration("2w", "keep"), std::chrono::hours(336));
  for (const char* text : {"", "d", "30", "30 d", "-1d", "1.5d", "1y", "99999999999999999999d",
                           "10001w", "9999999999h", "0x1d"}) {
    EXPECT_THROW((void)parse_duration(text, "keep"), UsageError) << text;
  }
}

PlateEvent event_of(const std::string& text, double first, double last) {
  PlateEvent event;
  event.text = text;
  event.confidence = 0.876;
  event.country = "es";
  event.candidates = {{text, 0.876, "es"}, {"OTHER1", 0.1, ""}};
  event.first_time = first;
  event.last_time = last;
  event.frames = 7;
  event.readings = {{3, first, text, 0.5, {1, 2, 3, 4}}};
  event.best_box = {10, 20, 30, 40};
  event.best_crop = cv::Mat(20, 80, CV_8UC3, cv::Scalar(40, 120, 200));
  return event;
}

std::int64_t count_of(PlateLog& log) {
  return log.query({}, [](const LoggedPlate&) { return true; });
}

std::int64_t add(PlateLog& log, PlateEvent event, const std::string& source, Moment origin) {
  const auto moment = [&](double seconds) {
    return origin + std::chrono::milliseconds(static_cast<std::int64_t>(1000 * seconds));
  };
  event.source = source;
  event.first_seen = moment(event.first_time);
  event.last_seen = moment(event.last_time);
  return log.append(event);
}

// The first version of the layout, with rows of (id, time, text).
const DatabaseKind kFirstVersion{"Tarsier plate log",
                                 0x54504C31,
                                 {"CREATE TABLE plate(id INTEGER PRIMARY KEY AUTOINCREMENT, "
                                  "first_time INTEGER NOT NULL, last_time INTEGER NOT NULL, source "
                                  "TEXT NOT NULL, text TEXT NOT NULL, confidence REAL NOT NULL, "
                                  "country TEXT NOT NULL, frames INTEGER NOT NULL, x INTEGER NOT "
                                  "NULL, y INTEGER NOT NULL, w INTEGER NOT NULL, h INTEGER NOT "
                                  "NULL, candidates TEXT NOT NULL, readings TEXT NOT NULL, crop "
                                  "BLOB) STRICT; CREATE INDEX plate_by_time ON plate(last_time);"}};
const DatabaseKind kThisVersion{"Tarsier plate log", 0x54504C31, {"", "", ""}};

class PlateLogTest : public FolderTest {
 protected:
  [[nodiscard]] PlateLog open(DatabaseAccess access = DatabaseAccess::kCreate) const {
    return PlateLog(path("plates.db"), access, 20);
  }
  void fill() const {
    PlateLog log = open();
    const Moment noon = moment_at("2024-05-01T12:00");
    add(log, event_of("1234BCD", 0, 10), "cam", noon);
    add(log, event_of("5678FGH", 60, 65.5), "gate", noon);
    add(log, event_of("M1234AB", 7200, 7300), "cam", noon);
  }
  static std::vector<std::string> texts(PlateLog& log, const LogFilter& filter = {}) {
    std::vector<std::string> found;
    log.query(filter, [&](const LoggedPlate& plate) {
      found.push_back(plate.text);
      return true;
    });
    return found;
  }
};

TEST_F(PlateLogTest, EntriesRoundTrip) {
  fill();
  PlateLog log = open(DatabaseAccess::kRead);
  LogFilter filter;
  filter.text = "5678FGH";
  std::vector<LoggedPlate> plates;
  EXPECT_EQ(log.query(filter,
                      [&](const LoggedPlate& plate) {
                        plates.push_back(plate);
                        return true;
                      }),
            1);
  ASSERT_EQ(plates.size(), 1U);
  const nlohmann::ordered_json object = logged_json(plates[0], "plates.db");
  EXPECT_EQ(object.at("source"), "gate");
  EXPECT_EQ(object.at("first_time"), "2024-05-01T12:01:00.000Z");
  EXPECT_EQ(object.at("last_time"), "2024-05-01T12:01:05.500Z");
  EXPECT_EQ(object.at("box"), nlohmann::json({10, 20, 30, 40}));
  EXPECT_EQ(object.at("candidates").at(1).at("text"), "OTHER1");
  EXPECT_EQ(object.at("readings").at(0).at("frame"), 3);
  EXPECT_EQ(object.at("state"), "closed");
  EXPECT_FALSE(object.contains("clock"));
  EXPECT_EQ(logged_csv_line(plates[0]),
            "2,2024-05-01T12:01:00.000Z,2024-05-01T12:01:05.500Z,gate,5678FGH,0.8760,es,7,10,20,"
            "30,40,closed,,,\n");
  const cv::Mat crop = decode_image(log.crop(plates[0].id), "crop");
  EXPECT_EQ(crop.size(), cv::Size(80, 20));
  EXPECT_NEAR(crop.at<cv::Vec3b>(10, 40)[2], 200, 4);
}

TEST_F(PlateLogTest, FiltersByTextTimeSourceAndNumber) {
  fill();
  PlateLog log = open(DatabaseAccess::kRead);
  EXPECT_THAT(texts(log), ElementsAre("M1234AB", "5678FGH", "1234BCD"));
  LogFilter filter;
  filter.limit = 2;
  EXPECT_THAT(texts(log, filter), ElementsAre("M1234AB", "5678FGH"));
  filter = {};
  filter.text = "*1234*";
  EXPECT_THAT(texts(log, filter), ElementsAre("M1234AB", "1234BCD"));
  filter.limit = 1;
  EXPECT_THAT(texts(log, filter), ElementsAre("M1234AB"));
  filter = {};
  filter.text = "S678FGH";
  EXPECT_THAT(texts(log, filter), IsEmpty());
  filter.near = true;
  EXPECT_THAT(texts(log, filter), ElementsAre("5678FGH"));
  filter = {};
  filter.source = "cam";
  EXPECT_THAT(texts(log, filter), ElementsAre("M1234AB", "1234BCD"));
  filter = {};
  filter.since = moment_at("2024-05-01T12:00:05");  // it was still in sight then
  filter.until = moment_at("2024-05-01T12:01");
  EXPECT_THAT(texts(log, filter), ElementsAre("5678FGH", "1234BCD"));
  filter.since = moment_at("2024-05-01T12:00:11");
  EXPECT_THAT(texts(log, filter), ElementsAre("5678FGH"));
}

TEST_F(PlateLogTest, ForgetFreesDiskSpace) {
  {
    PlateLog log = open();
    PlateEvent event = event_of("1234BCD", 0, 1);
    event.best_crop = cv::Mat(400, 600, CV_8UC3);
    cv::randu(event.best_crop, 0, 255);
    for (int k = 0; k < 10; ++k) add(log, event, "cam", moment_at("2024-05-01"));
    add(log, event_of("5678FGH", 0, 1), "cam", moment_at("2024-05-20"));
  }
  const auto before = std::filesystem::file_size(path("plates.db"));
  PlateLog log = open(DatabaseAccess::kWrite);
  const auto days = [](int count) { return std::chrono::hours(24 * count); };
  EXPECT_EQ(log.forget(moment_at("2024-05-11"), days(1)), 10);
  EXPECT_EQ(log.forget(moment_at("2024-05-11"), days(1)), 0);
  EXPECT_EQ(count_of(log), 1);
  EXPECT_THAT(texts(log), ElementsAre("5678FGH"));
  EXPECT_LT(std::filesystem::file_size(path("plates.db")), before / 4);
}

TEST_F(PlateLogTest, IdsAreNotReused) {
  PlateLog log = open();
  const std::int64_t first = add(log, event_of("1234BCD", 0, 1), "cam", moment_at("2024-05-01"));
  log.forget(moment_at("2024-06-02"), std::chrono::hours(24));
  EXPECT_GT(add(log, event_of("1234BCD", 0, 1), "cam", moment_at("2024-05-01")), first);
}

TEST_F(PlateLogTest, RemovesPasswordsFromSources) {
  PlateLog log = open();
  add(log, event_of("1234BCD", 0, 1), "http://me:secret@host/cam", moment_at("2024-05-01"));
  log.query({}, [](const LoggedPlate& plate) {
    EXPECT_THAT(plate.source, HasSubstr("host/cam"));
    EXPECT_THAT(plate.source, Not(HasSubstr("secret")));
    return true;
  });
}

TEST_F(PlateLogTest, StaysUsableAfterALock) {
  PlateLog log = open();
  add(log, event_of("1234BCD", 0, 1), "cam", moment_at("2024-05-01"));
  {
    Database other(path("plates.db"), kThisVersion, DatabaseAccess::kWrite, 20);
    const Transaction lock(other);
    EXPECT_THROW(add(log, event_of("5678FGH", 0, 1), "cam", moment_at("2024-05-01")), OutputError);
    EXPECT_THAT(texts(log), ElementsAre("1234BCD"));
  }
  add(log, event_of("5678FGH", 0, 1), "cam", moment_at("2024-05-01"));
  EXPECT_EQ(count_of(log), 2);
}

TEST_F(PlateLogTest, HandlesMalformedEntries) {
  fill();
  {
    Database other(path("plates.db"), kThisVersion, DatabaseAccess::kWrite, 20);
    other.run(
        "UPDATE plate SET candidates = '[[[', first_time = 9e18, x = 9e18, "
        "source = '=HYPERLINK()' WHERE id = 1");
  }
  PlateLog log = open(DatabaseAccess::kRead);
  LogFilter filter;
  filter.text = "1234BCD";
  log.query(filter, [](const LoggedPlate& plate) {
    EXPECT_THROW((void)logged_json(plate, "plates.db"), InputError);
    EXPECT_THAT(logged_csv_line(plate), HasSubstr(",'=HYPERLINK(),"));
    EXPECT_THAT(logged_csv_line(plate), HasSubstr("9999-12-31"));
    return true;
  });
}

// Each index finds the same entries as a comparison of every text with the pattern.
TEST_F(PlateLogTest, IndexedSearchEqualsAFullScan) {
  Rng rng(11);
  std::vector<std::string> written;
  {
    PlateLog log = open();
    Transaction together = log.transaction();
    for (int k = 0; k < 200; ++k) {
      std::string text;
      const int length = rng.integer(1, 8);
      for (int n = 0; n < length; ++n) text += "01ODIQAB"[rng.integer(0, 7)];
      written.push_back(text);
      PlateEvent event = event_of(text, k, k);
      event.last_seen = moment_at("2024-05-01") + std::chrono::seconds(k);
      (void)log.put(event, 0, 0, {});
    }
    together.commit();
  }
  PlateLog log = open(DatabaseAccess::kRead);
  for (int k = 0; k < 150; ++k) {
    LogFilter filter;
    const int length = rng.integer(1, 8);
    for (int n = 0; n < length; ++n) filter.text += "01ODIQAB?*"[rng.integer(0, 9)];
    for (const bool near : {false, true}) {
      filter.near = near;
      std::vector<std::string> expected;
      for (auto text = written.rbegin(); text != written.rend(); ++text) {
        if (matches(filter.text, *text, near)) expected.push_back(*text);
      }
      EXPECT_EQ(texts(log, filter), expected) << filter.text << (near ? ", near" : "");
    }
  }
}

TEST_F(PlateLogTest, ReadsAndUpgradesVersionOne) {
  {
    Database first(path("plates.db"), kFirstVersion, DatabaseAccess::kCreate);
    for (const char* text : {"1234BCD", "5678FGH", "OQ1"}) {
      Statement(first,
                "INSERT INTO plate(first_time, last_time, source, text, confidence, country, "
                "frames, x, y, w, h, candidates, readings) VALUES(1000, 2000, 'cam', ?, 0.9, '', "
                "1, 1, 2, 3, 4, '[]', '[]')")
          .bind(1, std::string_view(text))
          .step();
    }
  }
  LogFilter filter;
  filter.text = "*78F*";
  LogFilter near;
  near.text = "001";
  near.near = true;
  const auto expect_searches = [&](DatabaseAccess access) {
    PlateLog log = open(access);
    EXPECT_THAT(texts(log), ElementsAre("OQ1", "5678FGH", "1234BCD"));
    EXPECT_THAT(texts(log, filter), ElementsAre("5678FGH"));
    EXPECT_THAT(texts(log, near), ElementsAre("OQ1"));
  };
  expect_searches(DatabaseAccess::kRead);
  expect_searches(DatabaseAccess::kWrite);
  expect_searches(DatabaseAccess::kRead);
  // Its parts equal those of new entries.
  PlateLog log = open(DatabaseAccess::kWrite);
  PlateEvent event = event_of("5678FGH", 0, 1);
  event.source = "new";
  event.last_seen = moment_at("2024-05-01");
  log.append(event);
  EXPECT_THAT(texts(log, filter), ElementsAre("5678FGH", "5678FGH"));
  Database raw(path("plates.db"), kThisVersion, DatabaseAccess::kRead);
  Statement grams(raw,
                  "SELECT (SELECT group_concat(gram) FROM plate_gram WHERE plate = 2), (SELECT "
                  "group_concat(gram) FROM plate_gram WHERE plate = 4)");
  ASSERT_TRUE(grams.step());
  EXPECT_EQ(grams.text(0), grams.text(1));
}

TEST_F(PlateLogTest, OpenEntriesOfDeadProgramsBecomeInterrupted) {
  PlateEvent event = event_of("1234BCD", 0, 1);
  event.state = PlateState::kOpened;
  event.first_seen = moment_at("2024-05-01T12:00");
  event.last_seen = moment_at("2024-05-01T12:05");
  {
    PlateLog log = open();
    const std::int64_t dead = log.begin_run("dead", [](const std::string&) { return true; });
    const std::int64_t live = log.begin_run("live", [](const std::string&) { return true; });
    log.put(event, 0, dead, {});
    event.text = "5678FGH";
    log.put(event, 0, live, {});
  }
  const auto states = [&] {
    std::vector<std::string> found;
    open(DatabaseAccess::kRead).query({}, [&](const LoggedPlate& plate) {
      EXPECT_EQ(moment_text(plate.first_time), "2024-05-01T12:00:00.000Z");
      EXPECT_EQ(moment_text(plate.last_time), "2024-05-01T12:05:00.000Z");
      found.push_back(logged_json(plate, "plates.db").at("state"));
      return true;
    });
    return found;
  };
  EXPECT_THAT(states(), ElementsAre("open", "open"));
  (void)open().begin_run("next", [](const std::string& process) { return process == "live"; });
  EXPECT_THAT(states(), ElementsAre("open", "interrupted"));
}

TEST_F(PlateLogTest, OthersCanWriteBetweenBatchesOfForget) {
  {
    PlateLog log = open();
    Transaction together = log.transaction();
    for (int k = 0; k < 50; ++k) {
      PlateEvent event = event_of("1234BCD", k, k);
      event.last_seen = moment_at("2024-05-01") + std::chrono::seconds(k);
      (void)log.put(event, 0, 0, {});
    }
    together.commit();
  }
  PlateLog log = open(DatabaseAccess::kWrite);
  PlateLog other(path("plates.db"), DatabaseAccess::kWrite, 0);  // does not wait for the lock
  PlateLog reader = open(DatabaseAccess::kRead);
  std::int64_t batches = 0;
  ForgetOptions options;
  options.batch = 10;
  options.after_batch = [&](std::int64_t deleted) {
    ++batches;
    add(other, event_of("5678FGH", 0, 1), "cam", moment_at("2024-06-01"));
    EXPECT_EQ(count_of(reader), 50 - deleted + batches);
  };
  EXPECT_EQ(log.forget(moment_at("2024-06-01"), std::chrono::hours(24), options), 50);
  EXPECT_GE(batches, 5);
  EXPECT_EQ(count_of(log), batches);
  LogFilter filter;
  filter.text = "*34B*";
  EXPECT_THAT(texts(log, filter), IsEmpty());
  options.after_batch = [](std::int64_t) { throw Interrupted(); };
  EXPECT_THROW(log.forget(moment_at("2025-06-01"), std::chrono::hours(24), options), Interrupted);
}

TEST_F(PlateLogTest, ForgetKeepsRecentEntriesOfAWrongClock) {
  const auto month = std::chrono::hours(24 * 30);
  PlateLog log = open();
  const std::int64_t run = log.begin_run("me", [](const std::string&) { return true; });
  const auto put = [&](const std::string& text, const std::string& when) {
    PlateEvent event = event_of(text, 0, 1);
    event.first_seen = event.last_seen = moment_at(when);
    event.synchronized = false;
    return log.put(event, 0, run, {});
  };
  // A machine whose clock starts in the past and is never set.
  put("1111BBB", "2024-01-05T12:00");
  put("2222CCC", "2024-01-05T13:00");
  EXPECT_THROW(log.forget(moment_at("1970-01-01"), month), InputError);
  // After the next start the time is known. The entries may be of today, so they are kept for a
  // month from now ..
  EXPECT_EQ(log.forget(moment_at("2026-05-01"), month), 0);
  EXPECT_EQ(log.forget(moment_at("2026-05-20"), month), 0);
  // .. and not longer.
  EXPECT_EQ(log.forget(moment_at("2026-06-01"), month), 2);
  EXPECT_EQ(count_of(log), 0);
  // The clock is never set, but it advances. Entries a month older than the latest are deleted.
  put("3333DDD", "2024-02-01");
  put("4444FFF", "2024-03-15");
  EXPECT_EQ(log.forget(moment_at("2026-05-01"), month), 1);
  EXPECT_THAT(texts(log), ElementsAre("4444FFF"));
  // The clock is set: earlier entries get the right times, and then count as all others.
  log.shift_unsynchronized(run, moment_at("2026-05-02") - moment_at("2024-03-15"));
  log.trust_clock(run);
  log.query({}, [](const LoggedPlate& plate) {
    EXPECT_EQ(moment_text(plate.last_time), "2026-05-02T00:00:00.000Z");
    EXPECT_TRUE(plate.synchronized);
    return true;
  });
  EXPECT_EQ(log.forget(moment_at("2026-05-20"), month), 0);
  EXPECT_EQ(log.forget(moment_at("2026-06-02"), month), 1);
}

PlateCorrection correction_of(const std::string& text,
                              const std::string& when = "2024-06-01T08:00") {
  return {text, "Ann", moment_at(when)};
}

TEST_F(PlateLogTest, CorrectionKeepsTheOriginalText) {
  fill();
  PlateLog log = open(DatabaseAccess::kWrite);
  log.correct(2, correction_of("5678FCH"));
  std::optional<LoggedPlate> entry;
  LogFilter filter;
  filter.text = "5678FCH";
  log.query(filter, [&](const LoggedPlate& plate) {
    entry = plate;
    return true;
  });
  ASSERT_TRUE(entry);
  EXPECT_EQ(entry->text, "5678FGH");
  ASSERT_TRUE(entry->correction);
  EXPECT_EQ(entry->correction->text, "5678FCH");
  EXPECT_EQ(logged_json(*entry, "log")["correction"].dump(),
            R"({"text":"5678FCH","author":"Ann","time":"2024-06-01T08:00:00.000Z"})");
  EXPECT_THAT(logged_csv_line(*entry), HasSubstr(",closed,5678FCH,Ann,2024-06-01T08:00:00.000Z"));
}

TEST_F(PlateLogTest, SearchesFindBothTextsOnce) {
  fill();
  PlateLog log = open(DatabaseAccess::kWrite);
  log.correct(2, correction_of("9876XYZ"));
  for (const char* pattern :
       {"5678FGH", "56*", "*78F*", "?6*GH", "*", "9876XYZ", "98*", "*76X*", "?8*YZ", "*6?YZ"}) {
    LogFilter filter;
    filter.text = pattern;
    const std::vector<std::string> found = texts(log, filter);
    EXPECT_EQ(std::count(found.begin(), found.end(), "5678FGH"), 1) << pattern;
  }
  LogFilter near;
  near.near = true;
  near.text = "987SXYZ";
  EXPECT_THAT(texts(log, near), ElementsAre("5678FGH"));
  near.text = "5678FGX";
  EXPECT_THAT(texts(log, near), ElementsAre("5678FGH"));
}

TEST_F(PlateLogTest, UndoRemovesTheLastCorrection) {
  fill();
  PlateLog log = open(DatabaseAccess::kWrite);
  log.correct(2, correction_of("9876XYZ"));
  log.correct(2, correction_of("5678XYZ"));
  LogFilter filter;
  filter.text = "*76X*";
  EXPECT_THAT(texts(log, filter), IsEmpty());
  EXPECT_TRUE(log.undo_correction(2));
  EXPECT_THAT(texts(log, filter), ElementsAre("5678FGH"));
  EXPECT_TRUE(log.undo_correction(2));
  EXPECT_THAT(texts(log, filter), IsEmpty());
  EXPECT_FALSE(log.undo_correction(2));
  filter.text = "*78F*";  // parts that both texts contain remain
  EXPECT_THAT(texts(log, filter), ElementsAre("5678FGH"));
  EXPECT_THROW(log.correct(99, correction_of("1")), InputError);
  EXPECT_THROW((void)log.undo_correction(99), InputError);
  EXPECT_THROW(log.correct(2, correction_of("b")), std::invalid_argument);
  EXPECT_THROW(log.correct(2, correction_of("")), std::invalid_argument);
}

TEST_F(PlateLogTest, RemoveDeletesTheCorrection) {
  fill();
  PlateLog log = open(DatabaseAccess::kWrite);
  log.correct(1, correction_of("9876XYZ"));
  log.remove(1);
  Database raw(path("plates.db"), kThisVersion, DatabaseAccess::kRead);
  for (const char* query : {"SELECT count(*) FROM plate_correction",
                            "SELECT count(*) FROM plate_gram WHERE plate = 1"}) {
    Statement rows(raw, query);
    ASSERT_TRUE(rows.step());
    EXPECT_EQ(rows.integer(0), 0) << query;
  }
}

TEST_F(PlateLogTest, UpdatedEntryKeepsItsCorrection) {
  PlateLog log = open();
  PlateEvent event = event_of("1234BCD", 0, 1);
  event.first_seen = event.last_seen = moment_at("2024-05-01");
  event.state = PlateState::kOpened;
  const std::int64_t id = log.put(event, 0, 1, {});
  log.correct(id, correction_of("1284BCD"));
  event.text = "1284BCO";
  (void)log.put(event, id, 1, {});
  LogFilter filter;
  for (const char* pattern : {"*84BCD", "*84BCO"}) {
    filter.text = pattern;
    EXPECT_THAT(texts(log, filter), ElementsAre("1284BCO")) << pattern;
  }
}

TEST_F(PlateLogTest, HistoryUsesCorrectedTexts) {
  fill();
  PlateLog log = open(DatabaseAccess::kWrite);
  const Moment noon = moment_at("2024-05-01T12:00");
  add(log, event_of("1234BCD", 3600, 3700), "cam", noon);
  const Moment later = moment_at("2024-05-02");
  EXPECT_EQ(log.history("1234BCD", noon).visits, 0);
  PlateHistory history = log.history("1234BCD", later);
  EXPECT_EQ(history.visits, 2);
  EXPECT_EQ(history.first_time, noon);
  EXPECT_EQ(history.last_time, moment_at("2024-05-01T13:01:40"));
  log.correct(1, correction_of("5678FGH"));
  EXPECT_EQ(log.history("1234BCD", later).visits, 1);
  history = log.history("5678FGH", later);
  EXPECT_EQ(history.visits, 2);
  EXPECT_EQ(history.first_time, noon);
  log.correct(2, correction_of("5678FGH"));  // the same text: it was read rightly
  EXPECT_EQ(log.history("5678FGH", later).visits, 2);
}

}  // namespace
}  // namespace tarsier::plate
