// SPDX-License-Identifier: MIT
#include "tarsier/plate_video/log.h"

#include "tarsier/core/errors.h"
#include "tarsier/io/image_file.h"
#include "tarsier/io/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>

namespace tarsier::plate {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

Moment at(const std::string& text) { return parse_moment(text, {}, false, "time"); }

TEST(TimeTest, MomentsAreReadAndWritten) {
  EXPECT_EQ(moment_text(at("2024-05-01")), "2024-05-01T00:00:00.000Z");
  EXPECT_EQ(moment_text(at("2024-02-29T23:59")), "2024-02-29T23:59:00.000Z");
  EXPECT_EQ(moment_text(at("2024-05-01 12:30:15.25Z")), "2024-05-01T12:30:15.250Z");
  EXPECT_EQ(moment_text(at("2024-05-01T00:30+02:00")), "2024-04-30T22:30:00.000Z");
  EXPECT_EQ(moment_text(at("2024-05-01T00:30-01:30")), "2024-05-01T02:00:00.000Z");
  EXPECT_EQ(moment_text(parse_moment("2024-05-01", {}, true, "until")), "2024-05-01T23:59:59.999Z");
  EXPECT_EQ(parse_moment("2h", at("2024-05-01T12:00"), false, "since"), at("2024-05-01T10:00"));
  for (const char* text :
       {"", "now", "2024", "2024-13-01", "2023-02-29", "2024-05-01T", "24-05-01",
        "2024-05-01T24:00", "2024-05-01T12:60", "2024-05-01T12:30:15.", "2024-05-01T12:30Zx",
        "2024-05-01T12:30+2", "1969-12-31", "-2h", "2 h"}) {
    EXPECT_THROW((void)at(text), UsageError) << text;
  }
}

TEST(TimeTest, DurationsAreReadAndBounded) {
  EXPECT_EQ(parse_duration("90s", "keep"), std::chrono::seconds(90));
  EXPECT_EQ(parse_duration("30d", "keep"), std::chrono::hours(720));
  EXPECT_EQ(parse_duration("0m", "keep"), std::chrono::seconds(0));
  EXPECT_EQ(parse_duration("2w", "keep"), std::chrono::hours(336));
  for (const char* text : {"", "d", "30", "30 d", "-1d", "1.5d", "1y", "99999999999999999999d",
                           "10001w", "9999999999h", "0x1d"}) {
    EXPECT_THROW((void)parse_duration(text, "keep"), UsageError) << text;
  }
}

TEST(PatternTest, WildcardsAndOneError) {
  EXPECT_TRUE(matches("1234BCD", "1234BCD", false));
  EXPECT_FALSE(matches("1234BCD", "1234BCF", false));
  EXPECT_TRUE(matches("12?4*", "1284XYZ", false));
  EXPECT_FALSE(matches("12?4*", "1285XYZ", false));
  EXPECT_FALSE(matches("12?4", "12?45", false));
  EXPECT_TRUE(matches("*CD", "1234BCD", false));
  EXPECT_TRUE(matches("*", "", false));
  EXPECT_FALSE(matches("?", "", false));
  EXPECT_TRUE(matches("1*4*D", "1234BCD", false));

  EXPECT_TRUE(matches("1234BCD", "1284BCD", true));   // replaced
  EXPECT_TRUE(matches("1234BCD", "134BCD", true));    // missing
  EXPECT_TRUE(matches("1234BCD", "X1234BCD", true));  // too many
  EXPECT_FALSE(matches("1234BCD", "1284BCX", true));
  EXPECT_TRUE(matches("1204BCD", "I2O4BC0", true));  // all of them folded
  EXPECT_TRUE(matches("1204BCD", "I2O4BX0", true));  // and one more
  EXPECT_TRUE(matches("12?4*", "1285XYZ", true));
  EXPECT_FALSE(matches("12?4*", "1985XYZ", true));
}

TEST(PatternTest, WhatPeopleTypeIsCleaned) {
  EXPECT_EQ(plate_pattern("b-12?4 *"), "B12?4*");
  for (const char* text : {"", " - ", "B%", "x;y", "\xC3\x91"}) {
    EXPECT_THROW((void)plate_pattern(text), UsageError) << text;
  }
  EXPECT_THROW((void)plate_pattern(std::string(100, '*')), UsageError);
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

class PlateLogTest : public FolderTest {
 protected:
  [[nodiscard]] PlateLog open(DatabaseAccess access = DatabaseAccess::kCreate) const {
    return PlateLog(path("plates.db"), access, 20);
  }
  void fill() const {
    PlateLog log = open();
    const Moment noon = at("2024-05-01T12:00");
    log.append(event_of("1234BCD", 0, 10), "cam", noon);
    log.append(event_of("5678FGH", 60, 65.5), "gate", noon);
    log.append(event_of("M1234AB", 7200, 7300), "cam", noon);
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

TEST_F(PlateLogTest, EntriesComeBackWhole) {
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
  EXPECT_EQ(logged_csv_line(plates[0]),
            "2,2024-05-01T12:01:00.000Z,2024-05-01T12:01:05.500Z,gate,5678FGH,0.8760,es,7,10,20,"
            "30,40\n");
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
  filter.since = at("2024-05-01T12:00:05");  // it was still in sight
  filter.until = at("2024-05-01T12:01");
  EXPECT_THAT(texts(log, filter), ElementsAre("5678FGH", "1234BCD"));
  filter.since = at("2024-05-01T12:00:11");
  EXPECT_THAT(texts(log, filter), ElementsAre("5678FGH"));
}

TEST_F(PlateLogTest, ForgettingGivesTheRoomBack) {
  {
    PlateLog log = open();
    PlateEvent event = event_of("1234BCD", 0, 1);
    event.best_crop = cv::Mat(400, 600, CV_8UC3);
    cv::randu(event.best_crop, 0, 255);
    for (int k = 0; k < 10; ++k) log.append(event, "cam", at("2024-05-01"));
    log.append(event_of("5678FGH", 0, 1), "cam", at("2024-05-20"));
  }
  const auto before = std::filesystem::file_size(path("plates.db"));
  PlateLog log = open(DatabaseAccess::kWrite);
  EXPECT_EQ(log.forget_before(at("2024-05-10")), 10);
  EXPECT_EQ(log.forget_before(at("2024-05-10")), 0);
  EXPECT_EQ(log.count(), 1);
  EXPECT_THAT(texts(log), ElementsAre("5678FGH"));
  EXPECT_LT(std::filesystem::file_size(path("plates.db")), before / 4);
}

TEST_F(PlateLogTest, IdsAreNotUsedAgain) {
  PlateLog log = open();
  const std::int64_t first = log.append(event_of("1234BCD", 0, 1), "cam", at("2024-05-01"));
  log.forget_before(at("2024-06-01"));
  EXPECT_GT(log.append(event_of("1234BCD", 0, 1), "cam", at("2024-05-01")), first);
}

TEST_F(PlateLogTest, PasswordsStayOut) {
  PlateLog log = open();
  log.append(event_of("1234BCD", 0, 1), "http://me:secret@host/cam", at("2024-05-01"));
  log.query({}, [](const LoggedPlate& plate) {
    EXPECT_THAT(plate.source, HasSubstr("host/cam"));
    EXPECT_THAT(plate.source, Not(HasSubstr("secret")));
    return true;
  });
}

TEST_F(PlateLogTest, ALockIsAnErrorAndTheLogGoesOnAfterIt) {
  PlateLog log = open();
  log.append(event_of("1234BCD", 0, 1), "cam", at("2024-05-01"));
  {
    const DatabaseKind kind{"Tarsier plate log", 0x54504C31, {""}};
    Database other(path("plates.db"), kind, DatabaseAccess::kWrite, 20);
    const Transaction lock(other);
    EXPECT_THROW(log.append(event_of("5678FGH", 0, 1), "cam", at("2024-05-01")), OutputError);
    EXPECT_THAT(texts(log), ElementsAre("1234BCD"));
  }
  log.append(event_of("5678FGH", 0, 1), "cam", at("2024-05-01"));
  EXPECT_EQ(log.count(), 2);
}

TEST_F(PlateLogTest, HostileEntriesAreErrorsOrHarmless) {
  fill();
  {
    const DatabaseKind kind{"Tarsier plate log", 0x54504C31, {""}};
    Database other(path("plates.db"), kind, DatabaseAccess::kWrite, 20);
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

}  // namespace
}  // namespace tarsier::plate
