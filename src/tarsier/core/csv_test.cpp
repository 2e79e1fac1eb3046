// SPDX-License-Identifier: MIT
#include "tarsier/core/csv.h"

#include <gtest/gtest.h>

namespace tarsier {
namespace {

TEST(Csv, LinesRoundTrip) {
  const std::vector<std::string> fields = {"a.jpg", "x,y", "say \"hi\"", "", "-5", "tab\there"};
  const std::string line = csv_line(fields);
  EXPECT_EQ(line, "a.jpg,\"x,y\",\"say \"\"hi\"\"\",,-5,\"tab\there\"\n");
  EXPECT_EQ(csv_fields(line.substr(0, line.size() - 1)), fields);
}

TEST(Csv, QuotesFieldsThatNeedIt) {
  EXPECT_EQ(csv_field("plain name.png"), "plain name.png");
  EXPECT_EQ(csv_field(""), "");
  EXPECT_EQ(csv_field("a,b"), "\"a,b\"");
  EXPECT_EQ(csv_field("a\"b"), "\"a\"\"b\"");
  EXPECT_EQ(csv_field("\xC3\xA4"), "\xC3\xA4");
}

// A record is one line, also for readers that do not handle quotes.
TEST(Csv, LineBreaksBecomeSpaces) {
  EXPECT_EQ(csv_field("a\nb"), "a b");
  EXPECT_EQ(csv_field("a,\r\nb"), "\"a,  b\"");
}

TEST(Csv, EscapesSpreadsheetFormulas) {
  for (const char* text : {"=cmd()", "+1+1", "-1-1", "@SUM(1)", "=", "-.jpg", "--5"}) {
    EXPECT_EQ(csv_field(text), std::string("'") + text);
  }
  for (const char* text : {"-5", "-0.25", "-1e-3", "5", "1-1", "a=b", "'=x"}) {
    EXPECT_EQ(csv_field(text), text);
  }
  EXPECT_EQ(csv_field("=A1,B1"), "\"'=A1,B1\"");
}

TEST(Csv, RefusesUnclosedQuotes) {
  EXPECT_FALSE(csv_fields("a\"b,c").has_value());
  EXPECT_FALSE(csv_fields("\"a\"b,c").has_value());
  EXPECT_FALSE(csv_fields("a,\"b").has_value());
  EXPECT_EQ(csv_fields("")->size(), 1U);
}

}  // namespace
}  // namespace tarsier
