// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/watch.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <ctime>
#include <nlohmann/json.hpp>

namespace tarsier::plate {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr LocalTime kMondayNoon{0, 12 * 60};

WatchList list_of(const std::string& text) { return WatchList::parse(text, "list.csv"); }

std::string error_of(const std::string& text) {
  try {
    (void)list_of(text);
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

std::vector<std::string> found(const WatchList& list, const std::string& text,
                               LocalTime when = kMondayNoon) {
  std::vector<std::string> plates;
  for (const WatchMatch& match : list.matches(text, when, nullptr))
    plates.push_back(match.entry->plate);
  return plates;
}

// A vehicle whose plate moves from one box to another in ten readings.
PlateEvent moving(const std::string& text, cv::Rect from, cv::Rect to) {
  PlateEvent event;
  event.text = text;
  event.confidence = 0.9;
  for (int k = 0; k < 10; ++k) {
    const auto between = [k](int a, int b) { return a + (b - a) * k / 9; };
    event.readings.push_back({k,
                              0.1 * k,
                              text,
                              0.9,
                              {between(from.x, to.x), between(from.y, to.y),
                               between(from.width, to.width), between(from.height, to.height)}});
  }
  return event;
}

TEST(ReadingDistanceTest, ConfusionsCostLessThanOtherEdits) {
  EXPECT_EQ(reading_distance("1234BCD", "1234BCD"), 0);
  EXPECT_EQ(reading_distance("1234BCD", "1234BCO"), 0.25);
  EXPECT_EQ(reading_distance("1234BCD", "12348CO"), 0.5);
  EXPECT_EQ(reading_distance("1234NCD", "1234WCD"), 0.5);
  EXPECT_EQ(reading_distance("1234BCD", "1234XCD"), 1);
  EXPECT_EQ(reading_distance("1234BCD", "234BCD"), 1);
  EXPECT_EQ(reading_distance("1234BCD", "1234BCDD"), 1);
  EXPECT_EQ(reading_distance("", "AB"), 2);
  EXPECT_EQ(reading_distance("AB", ""), 2);
}

TEST(ReadingDistanceTest, WildcardsCostNothing) {
  EXPECT_EQ(reading_distance("12*", "1234BCD"), 0);
  EXPECT_EQ(reading_distance("*", ""), 0);
  EXPECT_EQ(reading_distance("?2*CD", "12CD"), 0);
  EXPECT_EQ(reading_distance("12??BCD", "1234BC0"), 0.25);
  EXPECT_EQ(reading_distance("1?", "1"), 1);
  EXPECT_EQ(reading_distance("B*8", "8XXXB"), 0.5);
}

TEST(ReadingDistanceTest, CostsAreSymmetric) {
  for (const char a : kAlphabet) {
    EXPECT_EQ(confusion_cost(a, a), 0);
    for (const char b : kAlphabet) EXPECT_EQ(confusion_cost(a, b), confusion_cost(b, a));
  }
  EXPECT_EQ(confusion_cost('6', '8'), 0.5);
  EXPECT_EQ(confusion_cost('4', 'Z'), 1);
}

TEST(WatchListTest, ParsesColumnsInAnyOrder) {
  const WatchList list = list_of(
      "# gate\r\nlabel,plate,days\r\n\"Ann, blue\",b-12?4*,mon-wed SUN\r\n\n# late\n,2471 kfd\n");
  ASSERT_THAT(list.entries(), SizeIs(2));
  const WatchEntry& first = list.entries()[0];
  EXPECT_EQ(first.plate, "B12?4*");
  EXPECT_EQ(first.label, "Ann, blue");
  EXPECT_EQ(first.errors, 0.25);
  EXPECT_EQ(first.days, 0b1000111U);
  EXPECT_EQ(first.comment, "# gate\n");
  EXPECT_EQ(list.entries()[1].plate, "2471KFD");
  EXPECT_EQ(list.entries()[1].comment, "# late\n");
}

TEST(WatchListTest, ParsesOnePlatePerLine) {
  EXPECT_THAT(list_of("2471KFD\n1234BCD,Ann,0\n").entries(), SizeIs(2));
  EXPECT_THAT(list_of("").entries(), IsEmpty());
  EXPECT_THAT(list_of("\xEF\xBB\xBFplate\n1\n").entries(), SizeIs(1));
}

TEST(WatchListTest, TextRoundTrips) {
  const std::string text =
      "# of the file\n"
      "plate,label,errors,direction,hours,days\n"
      "2471KFD,\"Ann, \"\"A\"\"\",0.5,approaching,22:00-06:00 12:00-13:30,mon-fri sun\n"
      "# below\n"
      "B*,'=SUM(A1),0.25,,,\n"
      "# the end\n";
  const WatchList list = list_of(text);
  EXPECT_EQ(list.text(), text);
  EXPECT_EQ(list.entries()[1].label, "=SUM(A1)");
  EXPECT_EQ(list_of("").text(), "plate,label,errors,direction,hours,days\n");
}

TEST(WatchListTest, ErrorNamesTheLine) {
  EXPECT_THAT(error_of("plate\n1234BCD\nB%\n"), HasSubstr("list.csv: line 3: plate 'B%'"));
  EXPECT_THAT(error_of("plate,colour\n"), HasSubstr("column 'colour': expected plate, label"));
  EXPECT_THAT(error_of("plate,plate\n"), HasSubstr("is there twice"));
  EXPECT_THAT(error_of("1234BCD,Ann,4\n"), HasSubstr("errors '4': expected 0..3"));
  EXPECT_THAT(error_of("1234BCD,Ann,nan\n"), HasSubstr("errors 'nan'"));
  EXPECT_THAT(error_of("1234BCD,,,north\n"), HasSubstr("direction 'north': expected one of"));
  EXPECT_THAT(error_of("1234BCD,,,,8-18\n"), HasSubstr("hours '8-18': expected 08:00-18:00"));
  EXPECT_THAT(error_of("1234BCD,,,,25:00-26:00\n"), HasSubstr("hours"));
  EXPECT_THAT(error_of("1234BCD,,,,08:00-08:00\n"), HasSubstr("hours"));
  EXPECT_THAT(error_of("1234BCD,,,,,monday\n"), HasSubstr("days 'monday': expected days as"));
  EXPECT_THAT(error_of("1234BCD,,,,,,more\n"), HasSubstr("7 fields, of 6 columns"));
  EXPECT_THAT(error_of("\"1234BCD\n"), HasSubstr("a quote is not closed"));
  EXPECT_THAT(error_of(",Ann\n"), HasSubstr("the plate is missing"));
  EXPECT_THAT(error_of("1234BCD," + std::string(201, 'x') + "\n"), HasSubstr("200 bytes"));
  EXPECT_THAT(error_of(std::string(65, 'A') + "\n"), HasSubstr("64 characters"));
  EXPECT_THAT(error_of(std::string("1\0002\n", 4)), HasSubstr("line 1"));
}

TEST(WatchListTest, MatchesUpToTheErrorsOfAnEntry) {
  const WatchList list = list_of("1234BCD,exact,0\n1234BCD,near,0.5\n1234BCD,far,1\n");
  EXPECT_THAT(found(list, "1234BCD"), SizeIs(3));
  EXPECT_THAT(found(list, "1234BC0"), SizeIs(2));
  EXPECT_THAT(found(list, "1234BCX"), SizeIs(1));
  EXPECT_THAT(found(list, "1234BXX"), IsEmpty());
  EXPECT_THAT(found(list, ""), IsEmpty());
}

TEST(WatchListTest, TheNearestEntryComesFirst) {
  const WatchList list = list_of("12*,some,0\n12348CD,near,1\n1234BCD,same,1\n");
  EXPECT_THAT(found(list, "1234BCD"), ElementsAre("12*", "1234BCD", "12348CD"));
}

TEST(WatchListTest, HoursOverMidnightBelongToTheDayBefore) {
  const WatchList list = list_of("1,night,0,,22:00-06:00,fri\n");
  EXPECT_THAT(found(list, "1", {4, 22 * 60}), SizeIs(1));
  EXPECT_THAT(found(list, "1", {5, 5 * 60 + 59}), SizeIs(1));
  EXPECT_THAT(found(list, "1", {5, 6 * 60}), IsEmpty());
  EXPECT_THAT(found(list, "1", {5, 22 * 60}), IsEmpty());
  EXPECT_THAT(found(list, "1", {4, 60}), IsEmpty());
  const WatchList sunday = list_of("1,night,0,,22:00-06:00,sun\n");
  EXPECT_THAT(found(sunday, "1", {0, 60}), SizeIs(1));
  const WatchList day = list_of("1,day,0,,08:00-12:00 13:00-24:00,mon-fri\n");
  EXPECT_THAT(found(day, "1", {0, 12 * 60 - 1}), SizeIs(1));
  EXPECT_THAT(found(day, "1", {0, 12 * 60}), IsEmpty());
  EXPECT_THAT(found(day, "1", {0, 24 * 60 - 1}), SizeIs(1));
  EXPECT_THAT(found(day, "1", {6, 9 * 60}), IsEmpty());
}

TEST(WatchListTest, DayRangesWrapAroundTheWeek) {
  EXPECT_EQ(parse_days("fri-mon", "days"), 0b1110001U);
  EXPECT_EQ(days_text(0b1110001U), "mon fri-sun");
  EXPECT_EQ(parse_days("", "days"), WatchEntry::kAllDays);
  EXPECT_EQ(parse_days("mon-sun", "days"), WatchEntry::kAllDays);
}

TEST(WatchListTest, MatchesDirectionsOfTheReadings) {
  const PlateEvent nearer = moving("1", {100, 100, 60, 15}, {100, 110, 100, 25});
  EXPECT_THAT(directions_of(nearer), ElementsAre(Direction::kApproaching));
  const PlateEvent receding = moving("1", {300, 100, 100, 25}, {100, 40, 60, 15});
  EXPECT_THAT(directions_of(receding),
              ElementsAre(Direction::kReceding, Direction::kLeft, Direction::kUp));
  EXPECT_THAT(directions_of(moving("1", {100, 100, 60, 15}, {110, 102, 61, 15})), IsEmpty());
  EXPECT_THAT(directions_of(PlateEvent()), IsEmpty());

  const WatchList list = list_of("1,in,0,approaching\n");
  EXPECT_TRUE(list.find(nearer, kMondayNoon));
  EXPECT_FALSE(list.find(receding, kMondayNoon));
}

TEST(WatchListTest, CandidatesHaveAnExtraCost) {
  const WatchList list = list_of("1234BCD,Ann,0.25\n");
  PlateEvent event;
  event.text = "1734BCD";
  event.confidence = 0.6;
  event.candidates = {{"1734BCD", 0.6, ""}, {"1234BCD", 0.3, ""}};
  const auto match = list.find(event, kMondayNoon);
  ASSERT_TRUE(match);
  EXPECT_EQ(match->distance, WatchList::kCandidateCost);
  EXPECT_EQ(watch_json(*match).dump(), R"({"label":"Ann","entry":"1234BCD","distance":0.25})");
  event.candidates[1].confidence = 0.05;
  EXPECT_FALSE(list.find(event, kMondayNoon));
  event.candidates[1].confidence = 0.3;
  EXPECT_FALSE(list_of("1234BCD,Ann,0\n").find(event, kMondayNoon));
}

TEST(WatchListTest, AddReplacesTheEntryOfTheSamePlate) {
  WatchList list = list_of("# cars\nplate\n1\n# two\n2\n");
  WatchEntry entry;
  entry.plate = "2";
  entry.label = "second";
  EXPECT_TRUE(list.add(entry));
  entry.plate = "3";
  EXPECT_FALSE(list.add(entry));
  EXPECT_EQ(list.text(),
            "# cars\nplate,label,errors,direction,hours,days\n1,,0.25,,,\n# two\n2,second,0.25,,,\n"
            "3,second,0.25,,,\n");
  EXPECT_TRUE(list.remove("1"));
  EXPECT_FALSE(list.remove("1"));
  EXPECT_THAT(list.text(), HasSubstr("# cars\n# two\nplate,"));
  entry.plate = "b";
  EXPECT_THROW(list.add(entry), std::invalid_argument);
}

TEST(WatchListTest, LocalTimeFollowsTheTimeZone) {
  const char* before = std::getenv("TZ");
  const std::string previous_zone = before == nullptr ? "" : before;
  ::setenv("TZ", "CET-1CEST,M3.5.0,M10.5.0/3", 1);
  ::tzset();
  const auto summer = local_time(parse_moment("2024-05-01T23:30", {}, false, "time"));
  EXPECT_EQ(summer.weekday, 3);  // Thursday
  EXPECT_EQ(summer.minute, 90);
  const auto winter = local_time(parse_moment("2024-01-01T11:00", {}, false, "time"));
  EXPECT_EQ(winter.weekday, 0);
  EXPECT_EQ(winter.minute, 12 * 60);
  if (before == nullptr) {
    ::unsetenv("TZ");
  } else {
    ::setenv("TZ", previous_zone.c_str(), 1);
  }
  ::tzset();
}

class WatchFileTest : public FolderTest {};

TEST_F(WatchFileTest, ReloadsChangesAndKeepsTheListOnErrors) {
  const std::string file = path("list.csv");
  EXPECT_THROW(WatchFile{file}, InputError);
  write_file_atomically(file, "1\n");
  WatchFile watched(file);
  EXPECT_THAT(watched.current().entries(), SizeIs(1));
  write_file_atomically(file, "1\n2\n");
  EXPECT_THAT(watched.current().entries(), SizeIs(2));
  write_file_atomically(file, "%\n");
  EXPECT_THAT(watched.current().entries(), SizeIs(2));
  EXPECT_THAT(watched.current().entries(), SizeIs(2));
  write_file_atomically(file, "3\n");
  EXPECT_EQ(watched.current().entries()[0].plate, "3");
}

}  // namespace
}  // namespace tarsier::plate
