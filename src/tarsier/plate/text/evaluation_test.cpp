// SPDX-License-Identifier: MIT
#include "tarsier/plate/text/evaluation.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

namespace tarsier::plate {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

Reading reading(const std::string& text, double confidence, cv::Rect box,
                const std::vector<std::string>& others = {}) {
  Reading result;
  result.text = text;
  result.confidence = confidence;
  result.box = box;
  if (!others.empty()) result.candidates.push_back({text, confidence, ""});
  for (const std::string& other : others) result.candidates.push_back({other, 0.01, ""});
  return result;
}

TEST(EvaluationTest, ComputesAllScores) {
  const PlateTruth truth{
      {"a.jpg", {{cv::Rect2d(0, 0, 100, 20), "1234BCD"}, {cv::Rect2d(200, 0, 100, 20), "5678FGH"}}},
      {"b.jpg", {{cv::Rect2d(0, 0, 100, 20), "M0-23AB"}}},
      {"c.jpg", {{cv::Rect2d(0, 0, 100, 20), ""}}},
      {"d.jpg", {{std::nullopt, "9999ZZZ"}}},
      {"e.jpg", {{cv::Rect2d(0, 0, 100, 20), "1111BBB"}}}};
  const std::vector<ImageReadings> readings{
      // The first is right. The second has one wrong character, but its text is among the
      // candidates.
      {"x/a.jpg",
       10,
       {reading("1234BCD", 0.9, {0, 0, 100, 20}),
        reading("5678FGN", 0.8, {200, 0, 100, 20}, {"5678FGH"})},
       {}},
      // Right except for the hidden character, and a false detection.
      {"b.jpg",
       30,
       {reading("MO923AB", 0.5, {0, 0, 100, 20}), reading("X", 0.1, {9, 90, 5, 5})},
       {}},
      // Overlap of 40 / 160: not found at 0.5 nor at 0.3.
      {"c.jpg", 20, {reading("", 0.2, {60, 0, 100, 20})}, {}},
      {"d.jpg", -1, {reading("9999ZZZ", 0.7, {5, 5, 5, 5})}, {}},
      {"unknown.jpg", 500, {reading("1111BBB", 1, {0, 0, 100, 20})}, {}}};
  const PlateScores scores = evaluate_plates(readings, truth, {});
  EXPECT_EQ(scores.images, 5);
  EXPECT_EQ(scores.truth, 6);
  EXPECT_EQ(scores.boxes, 5);
  EXPECT_EQ(scores.found, 3);
  EXPECT_EQ(scores.texts, 5);
  EXPECT_EQ(scores.exact, 2);  // a's first plate and d's
  EXPECT_EQ(scores.top10, 3);
  EXPECT_EQ(scores.returned, 6);
  EXPECT_DOUBLE_EQ(scores.recall, 3 / 5.0);
  EXPECT_DOUBLE_EQ(scores.precision, 4 / 6.0);
  // 7 + 6 + (6 visible, of which the O is wrong) + 7 of 7 + 7 + 6 + 7 + 7.
  EXPECT_DOUBLE_EQ(scores.character_rate, 25 / 34.0);
  EXPECT_DOUBLE_EQ(scores.found_character_rate, 25 / 27.0);
  // Right: 0.9, 0.7. Wrong: 0.8, 0.5.
  EXPECT_DOUBLE_EQ(scores.confidence_auc, 3 / 4.0);
  // The letter O read for b's digit 0 is right if both count as one symbol.
  EXPECT_EQ(scores.exact_o_as_0, 3);
  // Each confidence is alone in its bin of width 0.1: 0.1 + 0.3 (right) + 0.8 + 0.5 (wrong), of
  // four.
  EXPECT_EQ(scores.evaluated, 4);
  EXPECT_NEAR(scores.calibration_error, 1.7 / 4, 1e-12);
  EXPECT_EQ(scores.high_confidence, 0);
  const nlohmann::ordered_json object = scores_json(scores);
  // Wilson's interval of 2 of 5.
  EXPECT_EQ(object.at("exact_interval"), nlohmann::ordered_json({0.1176, 0.7693}));
  EXPECT_TRUE(object.at("sure_wrong_interval").is_null());
  EXPECT_DOUBLE_EQ(scores.median_ms, 20);
  EXPECT_DOUBLE_EQ(scores.p90_ms, 20);
  ASSERT_EQ(scores.outcomes.size(), 5U);
  EXPECT_EQ(scores.outcomes[1].edits, 1);
  EXPECT_EQ(scores.outcomes[1].reading->text, "5678FGN");
  EXPECT_FALSE(scores.outcomes[4].found);

  EvaluationOptions folded;
  folded.fold = true;
  EXPECT_EQ(evaluate_plates(readings, truth, folded).exact, 3);
  EvaluationOptions loose;
  loose.iou = 0.2;
  EXPECT_EQ(evaluate_plates(readings, truth, loose).found, 3);  // 0.3 is the min overlap
}

TEST(EvaluationTest, ReadingWithTheLargerOverlapIsMatched) {
  const PlateTruth truth{{"a.jpg", {{cv::Rect2d(0, 0, 100, 20), "A1"}}}};
  const std::vector<ImageReadings> readings{
      {"a.jpg", 1, {reading("B2", 0.9, {0, 0, 100, 28}), reading("A1", 0.1, {0, 0, 100, 21})}, {}}};
  const PlateScores scores = evaluate_plates(readings, truth, {});
  EXPECT_EQ(scores.exact, 1);
  EXPECT_DOUBLE_EQ(scores.precision, 0.5);
  EXPECT_LT(scores.confidence_auc, 0);
}

TEST(EvaluationTest, CountsWrongTextsOfHighConfidence) {
  const PlateTruth truth{{"a.jpg", {{cv::Rect2d(0, 0, 100, 20), "1234BCD"}}},
                         {"b.jpg", {{cv::Rect2d(0, 0, 100, 20), "5678FGH"}}}};
  const std::vector<ImageReadings> readings{
      {"a.jpg", -1, {reading("1234BCD", 0.95, {0, 0, 100, 20})}, {}},
      {"b.jpg", -1, {reading("5678FGN", 0.99, {0, 0, 100, 20})}, {}}};
  const PlateScores scores = evaluate_plates(readings, truth, {});
  EXPECT_EQ(scores.high_confidence, 2);
  EXPECT_EQ(scores.high_confidence_wrong, 1);
  // Both are in the last bin: one of two is right, mean confidence 0.97.
  EXPECT_NEAR(scores.calibration_error, 0.47, 1e-12);
}

TEST(EvaluationTest, SkipsCalibrationIfConfidencesAreNoProbabilities) {
  const PlateTruth truth{{"a.jpg", {{cv::Rect2d(0, 0, 100, 20), "1234BCD"}}}};
  for (const double confidence : {94.2, -0.05, 9223372036854775807.0}) {
    const std::vector<ImageReadings> readings{
        {"a.jpg", -1, {reading("1234BCD", confidence, {0, 0, 100, 20})}, {}}};
    const PlateScores scores = evaluate_plates(readings, truth, {});
    EXPECT_EQ(scores.exact, 1);
    EXPECT_EQ(scores.evaluated, 0) << confidence;
    EXPECT_LT(scores.calibration_error, 0);
    EXPECT_EQ(scores.high_confidence, 0);
  }
}

TEST(EvaluationTest, ScoresWithoutDataAreNull) {
  const PlateScores scores = evaluate_plates({}, {}, {});
  EXPECT_LT(scores.recall, 0);
  const nlohmann::ordered_json object = scores_json(scores);
  EXPECT_TRUE(object.at("recall").is_null());
  EXPECT_TRUE(object.at("median_ms").is_null());
  EXPECT_EQ(object.at("counts"), "found 0/0 exact 0/0 any 0 top10 0 returned 0");
  EvaluationOptions options;
  options.iou = 0;
  EXPECT_THROW((void)evaluate_plates({}, {}, options), std::invalid_argument);
}

std::string error_of_lines(const std::string& text) {
  std::istringstream lines(text);
  try {
    (void)parse_readings(lines, "r.jsonl");
  } catch (const InputError& error) {
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    return error.what();
  }
  return "accepted";
}

TEST(EvaluationTest, ParsesLinesOfReadings) {
  std::istringstream lines(
      "{\"image\":\"a.jpg\",\"ms\":1.5,\"plates\":[{\"text\":\"A1\",\"confidence\":0.5,"
      "\"box\":[1.5,2,3,4],\"candidates\":[\"A1\",{\"text\":\"A7\",\"confidence\":0.1}],"
      "\"other\":{}}]}\r\n\n"
      "{\"image\":\"b.jpg\"}\n{\"image\":\"c.jpg\",\"plates\":[{\"text\":\"B2\"}]}");
  const std::vector<ImageReadings> readings = parse_readings(lines, "r.jsonl");
  ASSERT_EQ(readings.size(), 3U);
  EXPECT_EQ(readings[0].milliseconds, 1.5);
  EXPECT_EQ(readings[0].boxes[0], cv::Rect2d(1.5, 2, 3, 4));
  EXPECT_EQ(readings[0].plates[0].candidates[1].text, "A7");
  EXPECT_LT(readings[1].milliseconds, 0);
  EXPECT_EQ(readings[2].plates[0].confidence, 0);
}

TEST(EvaluationTest, ErrorNamesTheLine) {
  const std::string good = "{\"image\":\"a\"}\n";
  EXPECT_THAT(error_of_lines(good + "{\"image\":}\n"), HasSubstr("r.jsonl: line 2, column 10: "));
  EXPECT_THAT(error_of_lines(good + good + "[]\n"), HasSubstr("line 3: a JSON object"));
  EXPECT_THAT(error_of_lines("{}\n"), HasSubstr("line 1: no text \"image\""));
  EXPECT_THAT(error_of_lines("{\"image\":7}\n"), HasSubstr("no text \"image\""));
  EXPECT_THAT(error_of_lines("{\"image\":\"a\",\"plates\":7}\n"), HasSubstr("\"plates\""));
  EXPECT_THAT(error_of_lines("{\"image\":\"a\",\"plates\":[7]}\n"), HasSubstr("not a JSON object"));
  EXPECT_THAT(error_of_lines("{\"image\":\"a\",\"plates\":[{}]}\n"), HasSubstr("\"text\""));
  const auto plate = [](const std::string& members) {
    return "{\"image\":\"a\",\"plates\":[{\"text\":\"A\"," + members + "}]}\n";
  };
  EXPECT_THAT(error_of_lines(plate("\"box\":[1,2,3]")), HasSubstr("four numbers"));
  EXPECT_THAT(error_of_lines(plate("\"box\":[1,2,3,\"4\"]")), HasSubstr("four numbers"));
  EXPECT_THAT(error_of_lines(plate("\"box\":[1,2,3,1e300]")), HasSubstr("four numbers"));
  EXPECT_THAT(error_of_lines(plate("\"confidence\":\"x\"")), HasSubstr("expected a number"));
  EXPECT_THAT(error_of_lines(plate("\"candidates\":[1]")), HasSubstr("candidate"));
  EXPECT_THAT(error_of_lines(std::string(100'000, '[')), HasSubstr("line 1"));
  EXPECT_THAT(error_of_lines("\xFF\xFE\n"), HasSubstr("UTF-8"));
}

class TruthTest : public FolderTest {
 protected:
  [[nodiscard]] PlateTruth truth_of(const std::string& text) const {
    write_file_atomically(path("truth.csv"), text);
    return read_plate_truth(path("truth.csv"));
  }
  [[nodiscard]] std::string error_of(const std::string& text) const {
    try {
      (void)truth_of(text);
    } catch (const InputError& error) {
      return error.what();
    }
    return "accepted";
  }
};

TEST_F(TruthTest, ReadsBoxesTextsAndEmptyFields) {
  const PlateTruth truth = truth_of(
      "\xEF\xBB\xBFimage,x,y,w,h,text,note\r\n\"p/a,1.jpg\",1,2.5,3,4,12-4bcd,\"said "
      "\"\"so\"\"\"\r\n"
      "b.jpg,,,,,AB 123,\nb.jpg,5,6,7,8,,\n\n");
  ASSERT_EQ(truth.size(), 2U);
  const TruthPlate& first = truth.at("a,1.jpg")[0];
  EXPECT_EQ(*first.box, cv::Rect2d(1, 2.5, 3, 4));
  EXPECT_EQ(first.text, "12-4BCD");
  EXPECT_FALSE(truth.at("b.jpg")[0].box.has_value());
  EXPECT_EQ(truth.at("b.jpg")[0].text, "AB123");
  EXPECT_EQ(truth.at("b.jpg")[1].text, "");
}

TEST_F(TruthTest, WarnsOfHyphens) {
  const auto warning_of = [&](const std::string& rows) {
    testing::internal::CaptureStderr();
    (void)truth_of("image,x,y,w,h,text\n" + rows);
    return testing::internal::GetCapturedStderr();
  };
  EXPECT_THAT(warning_of("a.jpg,,,,,1-34BC-\na.jpg,,,,,12--BCD\n"), ::testing::IsEmpty());
  EXPECT_THAT(warning_of("a.jpg,,,,,92-5-TXW\na.jpg,,,,,AB-12\na.jpg,,,,,1234BCD\n"),
              HasSubstr("2 texts like 92-5-TXW"));
  EXPECT_THAT(warning_of("a.jpg,,,,,A-B-C-D\n"), HasSubstr("1 texts like A-B-C-D"));
}

TEST_F(TruthTest, ErrorNamesTheLine) {
  const std::string header = "image,x,y,w,h,text\n";
  EXPECT_THAT(error_of(""), HasSubstr("empty"));
  EXPECT_THAT(error_of("image,x,y,w,text\n"), HasSubstr("no column 'h'"));
  EXPECT_THAT(error_of(header + "a.jpg,1,2,3\n"), HasSubstr("line 2: 4 fields"));
  EXPECT_THAT(error_of(header + "a.jpg,1,2,3,4,T\na.jpg,1,2,x,4,T\n"),
              HasSubstr("line 3: 'x' is not a valid w"));
  EXPECT_THAT(error_of(header + "a.jpg,nan,2,3,4,T\n"), HasSubstr("'nan' is not a valid x"));
  EXPECT_THAT(error_of(header + "a.jpg,1,2,-3,4,T\n"), HasSubstr("'-3' is not a valid w"));
  EXPECT_THAT(error_of(header + "a.jpg,1,2,,4,T\n"), HasSubstr("'' is not a valid w"));
  EXPECT_THAT(error_of(header + "\"a.jpg,1,2,3,4,T\n"), HasSubstr("quote"));
  EXPECT_THAT(error_of(header + ",1,2,3,4,T\n"), HasSubstr("no image"));
  EXPECT_THROW((void)read_plate_truth(path("missing.csv")), InputError);
}

}  // namespace
}  // namespace tarsier::plate
