// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/competing_readings.h"

#include "tarsier/plate/networks/quad.h"

#include <gtest/gtest.h>

#include <string>

namespace tarsier::plate {
namespace {

// A plate whose text fills `line`.
Reading reading_of(const std::string& text, const cv::Rect2f& plate, const cv::Rect2f& line) {
  Reading reading;
  reading.text = text;
  reading.confidence = 0.5;
  reading.plate = 0.99;
  reading.corners = quad_of(plate);
  reading.box = cv::Rect(plate);
  const float pitch = line.width / static_cast<float>(text.size());
  for (std::size_t i = 0; i < text.size(); ++i) {
    const cv::Rect2f box(line.x + pitch * static_cast<float>(i), line.y, pitch, line.height);
    reading.characters.push_back({text[i], 0.9, quad_of(box)});
  }
  return reading;
}

TEST(Slogans, SmallTextAboveThePlateTextIsASlogan) {
  Reading plate = reading_of("OUQ6314", {100, 100, 400, 130}, {120, 145, 360, 70});
  plate.confidence = 0.1;
  Reading town = reading_of("SALVADOR", {240, 108, 120, 24}, {245, 112, 110, 16});
  town.confidence = 0.9;
  EXPECT_EQ(are_slogans({town, plate}), (std::vector<bool>{true, false}));
}

TEST(Slogans, SeparatePlatesAndPartsAreNotSlogans) {
  const Reading plate = reading_of("OUQ6314", {100, 100, 400, 130}, {120, 145, 360, 70});
  const Reading far = reading_of("SALVADOR", {240, 20, 120, 24}, {245, 22, 110, 16});
  const Reading part = reading_of("UQ63", {150, 140, 200, 80}, {155, 146, 190, 68});
  EXPECT_EQ(are_slogans({plate, far, part}), (std::vector<bool>{false, false, false}));
  Reading uncertain_plate = plate;
  uncertain_plate.plate = 0.5;
  const Reading town = reading_of("SALVADOR", {240, 108, 120, 24}, {245, 112, 110, 16});
  EXPECT_EQ(are_slogans({uncertain_plate, town}), (std::vector<bool>{false, false}));
}

TEST(CompetingReadings, OneOfTwoOverlappingReadingsIsKept) {
  Reading plate = reading_of("OUQ6314", {100, 100, 400, 130}, {120, 145, 360, 70});
  Reading part = reading_of("UQ631", {120, 110, 330, 110}, {125, 146, 320, 68});
  part.plate = 0.6;
  part.confidence = 0.4;
  const std::vector<Reading> readings = suppress_competing({part, plate});
  ASSERT_EQ(readings.size(), 1U);
  EXPECT_EQ(readings[0].text, "OUQ6314");
}

}  // namespace
}  // namespace tarsier::plate
