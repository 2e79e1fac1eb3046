// SPDX-License-Identifier: MIT
#include "ui/window_lines.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>
#include <string>

namespace tarsier {
namespace {

using ::testing::HasSubstr;

TEST(WindowLine, ParsesEachKindOfEvent) {
  WindowLine line = parse_window_line(R"({"key":115,"shift":true})");
  ASSERT_TRUE(line.event);
  EXPECT_EQ(line.event->kind, Event::Kind::kKey);
  EXPECT_EQ(line.event->key, 's');
  EXPECT_TRUE(line.event->shift);
  EXPECT_FALSE(line.event->control);
  EXPECT_EQ(parse_window_line(R"({"key":65538})").event->key, key::kRight);

  line = parse_window_line(R"({"mouse":"wheel","x":10.5,"y":-3,"wheel":-2,"control":true})");
  EXPECT_EQ(line.event->kind, Event::Kind::kMouse);
  EXPECT_EQ(line.event->mouse, Event::Mouse::kWheel);
  EXPECT_EQ(line.event->x, 10.5);
  EXPECT_EQ(line.event->y, -3);
  EXPECT_EQ(line.event->wheel, -2);
  EXPECT_TRUE(line.event->control);
  EXPECT_EQ(parse_window_line(R"({"mouse":"double","x":1,"y":2})").event->mouse,
            Event::Mouse::kDouble);

  line = parse_window_line(R"({"action":"sketch"})");
  EXPECT_EQ(line.event->kind, Event::Kind::kAction);
  EXPECT_EQ(line.event->name, "sketch");
  line = parse_window_line(R"({"slider":"mode 1","value":-2.25})");
  EXPECT_EQ(line.event->kind, Event::Kind::kSlider);
  EXPECT_EQ(line.event->name, "mode 1");
  EXPECT_EQ(line.event->value, -2.25);
}

TEST(WindowLine, ParsesRequests) {
  WindowLine line = parse_window_line(R"({"want":1,"quality":60,"max_width":640})");
  EXPECT_FALSE(line.event);
  EXPECT_EQ(line.want, true);
  EXPECT_EQ(line.quality, 60);
  EXPECT_EQ(line.max_width, 640);
  EXPECT_FALSE(line.close);
  EXPECT_EQ(parse_window_line(R"({"want":0})").want, false);
  EXPECT_EQ(parse_window_line(R"({"max_width":0})").max_width, 0);
  EXPECT_EQ(parse_window_line(R"({"stages":1})").stages, true);
  EXPECT_EQ(parse_window_line(R"({"stages":0})").stages, false);
  line = parse_window_line(R"({"mouse":"move","x":1,"y":2,"width":640})");
  EXPECT_EQ(line.image_width, 640);
  EXPECT_TRUE(parse_window_line(R"({"close":true})").close);
  EXPECT_FALSE(parse_window_line(R"({"close":false})").close);
}

TEST(WindowLine, RefusesInvalidLines) {
  const std::string long_name(201, 'a');
  for (const std::string& text : {
           std::string("key"),
           std::string("[1]"),
           std::string("{}"),
           std::string("{\"key\":"),
           std::string(R"({"other":1})"),
           std::string(R"({"key":"s"})"),
           std::string(R"({"key":0})"),
           std::string(R"({"key":1.5})"),
           std::string(R"({"key":1e99})"),
           std::string(R"({"key":115,"shift":1})"),
           std::string(R"({"key":115,"action":"sketch"})"),
           std::string(R"({"mouse":"move"})"),
           std::string(R"({"mouse":"jump","x":1,"y":1})"),
           std::string(R"({"mouse":"move","x":1e7,"y":1})"),
           std::string(R"({"mouse":"move","x":null,"y":1})"),
           std::string(R"({"mouse":"wheel","x":1,"y":1,"wheel":1000})"),
           std::string(R"({"action":""})"),
           std::string(R"({"action":3})"),
           R"({"action":")" + long_name + "\"}",
           std::string(R"({"slider":"threshold"})"),
           std::string(R"({"slider":"threshold","value":"1"})"),
           std::string(R"({"slider":"threshold","value":1e300})"),
           std::string(R"({"want":-1})"),
           std::string(R"({"want":true})"),
           std::string(R"({"stages":true})"),
           std::string(R"({"mouse":"move","x":1,"y":1,"width":0})"),
           std::string(R"({"mouse":"move","x":1,"y":1,"width":"640"})"),
           std::string(R"({"quality":0})"),
           std::string(R"({"quality":101})"),
           std::string(R"({"max_width":15})"),
           std::string(R"({"max_width":100000})"),
           std::string(R"({"close":1})"),
       })
    EXPECT_THROW((void)parse_window_line(text), std::invalid_argument) << text;
}

TEST(WindowLines, ResultIsIndependentOfPieceSize) {
  const std::string text =
      "{\"key\":97}\n\n  \r\n{\"action\":\"x\"}\r\nno\n{\"want\":1}\n{\"key\":98";
  for (const std::size_t size : {std::size_t{1}, std::size_t{3}, text.size()}) {
    WindowLines lines;
    std::vector<WindowLine> all;
    for (std::size_t at = 0; at < text.size(); at += size)
      for (WindowLine& line : lines.feed(std::string_view(text).substr(at, size)))
        all.push_back(std::move(line));
    ASSERT_EQ(all.size(), 3U) << size;
    EXPECT_EQ(all[0].event->key, 'a');
    EXPECT_EQ(all[1].event->name, "x");
    EXPECT_EQ(all[2].want, true);
    EXPECT_EQ(lines.refused(), 1U);
    EXPECT_THAT(lines.last_error(), HasSubstr("expected a JSON object"));
  }
}

TEST(WindowLines, SkipsOverlongLinesWithoutStoringThem) {
  WindowLines lines;
  const std::string piece(1000, 'x');
  for (int i = 0; i < 1000; ++i) {
    EXPECT_TRUE(lines.feed(piece).empty());
    EXPECT_LE(lines.held_bytes(), 2 * WindowLines::kMaxLineLength);
  }
  EXPECT_EQ(lines.refused(), 1U) << "said once";
  EXPECT_THAT(lines.last_error(), HasSubstr("64 kB"));
  const std::vector<WindowLine> after = lines.feed("\n{\"key\":97}\n");
  ASSERT_EQ(after.size(), 1U);
  EXPECT_EQ(after[0].event->key, 'a');
  // The longest that is allowed.
  std::string longest = R"({"key":98})";
  longest.resize(WindowLines::kMaxLineLength, ' ');
  EXPECT_EQ(lines.feed(longest + "\n").size(), 1U);
  EXPECT_EQ(lines.feed(" " + longest + "\n").size(), 0U);
  EXPECT_EQ(lines.refused(), 2U);
}

}  // namespace
}  // namespace tarsier
