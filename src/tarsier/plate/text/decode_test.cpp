// SPDX-License-Identifier: MIT
#include "tarsier/plate/text/decode.h"

#include "tarsier/core/rng.h"
#include "tarsier/plate/text/ctc.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>

namespace tarsier::plate {
namespace {

constexpr const char* kSpain = "set C = BCDFGHJKLMNPRSTVWXYZ\nDDDD CCC\n";

CountryChoice choice_of(const std::string& text, bool free_text = false,
                        const std::string& code = "es") {
  CountryChoice choice;
  choice.layouts = parse_country(text, code + ".txt").layouts;
  choice.free_text = free_text;
  return choice;
}

std::vector<DecodedText> decode(const cv::Mat& probabilities, const CountryChoice& choice,
                                const DecodeOptions& options) {
  return Decoder(choice, options).decode(probabilities);
}

// The content of one column: symbols with their probabilities, the rest blank.
using Column = std::map<char, float>;

cv::Mat columns_of(const std::vector<Column>& columns) {
  cv::Mat rows(static_cast<int>(columns.size()), kClasses, CV_32F, cv::Scalar(0));
  for (int y = 0; y < rows.rows; ++y) {
    float blank = 1;
    for (const auto& [symbol, p] : columns[static_cast<std::size_t>(y)]) {
      rows.at<float>(y, class_of(symbol)) = p;
      blank -= p;
    }
    rows.at<float>(y, kBlank) = std::max(blank, 0.0F);
  }
  return rows;
}

// A column of high probability for each character, followed by a blank column.
cv::Mat confident_columns(const std::string& text,
                          std::vector<std::pair<std::size_t, Column>> changes = {}) {
  std::vector<Column> columns;
  for (const char symbol : text) {
    columns.push_back({{symbol, 0.98F}});
    columns.push_back({{symbol, 0.01F}});
  }
  for (auto& [position, column] : changes) columns[2 * position] = std::move(column);
  return columns_of(columns);
}

cv::Mat random_columns(int count, const std::string& symbols, Rng& rng) {
  cv::Mat rows(count, kClasses, CV_32F, cv::Scalar(0));
  for (int y = 0; y < count; ++y) {
    double sum = 0;
    const auto put = [&](int k) {
      const double value = std::exp(2 * rng.normal());
      rows.at<float>(y, k) = static_cast<float>(value);
      sum += value;
    };
    for (const char symbol : symbols) put(class_of(symbol));
    put(kBlank);
    rows.row(y) /= sum;
  }
  return rows;
}

// The probability of every text, by enumerating all paths.
void add_paths(const cv::Mat& rows, int y, double p, int last, const std::string& text,
               std::map<std::string, double>& texts) {
  if (y == rows.rows) {
    texts[text] += p;
    return;
  }
  for (int k = 0; k < kClasses; ++k) {
    const auto q = static_cast<double>(rows.at<float>(y, k));
    if (q <= 0) continue;
    const bool writes = k != kBlank && k != last;
    const std::string next = writes ? text + kAlphabet[static_cast<std::size_t>(k)] : text;
    const bool direct = writes && last >= 0 && last != kBlank;
    add_paths(rows, y + 1, p * q * (direct ? kDirectTransitionWeight : 1), k, next, texts);
  }
}

TEST(CtcTest, ProbabilityIsTheSumOverAllPaths) {
  Rng rng(5);
  for (int trial = 0; trial < 20; ++trial) {
    const cv::Mat rows = random_columns(6, "01A", rng);
    std::map<std::string, double> texts;
    add_paths(rows, 0, 1, -1, "", texts);
    for (const auto& [text, p] : texts) {
      std::vector<int> classes;
      for (const char symbol : text) classes.push_back(class_of(symbol));
      EXPECT_NEAR(std::exp(log_probability(rows, classes)), p, 1e-6) << text;
    }
    EXPECT_EQ(log_probability(rows, {2}), -std::numeric_limits<double>::infinity());
    EXPECT_EQ(log_probability(rows, {0, 0, 0, 0}), -std::numeric_limits<double>::infinity());
  }
}

TEST(DecodeTest, WideBeamEqualsFullEnumeration) {
  Rng rng(7);
  DecodeOptions options;
  options.beam = 1000;
  options.candidates = 100;
  options.min_length = 1;
  options.free_penalty = 1.5;
  for (int trial = 0; trial < 30; ++trial) {
    const cv::Mat rows = random_columns(6, "01A", rng);
    const CountryChoice choice = choice_of("DD weight 3\nDLL weight 1\n", trial % 2 == 1);
    std::map<std::string, double> texts;
    add_paths(rows, 0, 1, -1, "", texts);
    std::vector<std::pair<double, std::string>> expected;
    for (const auto& [text, p] : texts) {
      const auto digit = [&](std::size_t k) { return text[k] <= '9'; };
      double prior = choice.free_text && !text.empty() ? -1.5 : -1e9;
      if (text.size() == 2 && digit(0) && digit(1)) {
        prior = std::log(0.75) + options.specificity * 2 * std::log(3.6);
      }
      if (text.size() == 3 && digit(0) && !digit(1) && !digit(2)) {
        prior = std::log(0.25) + options.specificity * (std::log(3.6) + 2 * std::log(36.0 / 26));
      }
      if (prior > -1e8) expected.emplace_back(std::log(p) + prior, text);
    }
    std::sort(expected.rbegin(), expected.rend());
    double total = 0;
    for (const auto& [score, text] : expected) total += std::exp(score);
    const std::vector<DecodedText> found = decode(rows, choice, options);
    ASSERT_EQ(found.size(), std::min<std::size_t>(100, expected.size()));
    for (std::size_t k = 0; k < found.size(); ++k) {
      EXPECT_NEAR(found[k].log_score, expected[k].first, 1e-4) << found[k].text;
      EXPECT_NEAR(found[k].posterior, std::exp(expected[k].first) / total, 1e-4);
      if (k < 10) {
        EXPECT_EQ(found[k].text, expected[k].second);
      }
    }
  }
}

TEST(DecodeTest, LayoutSeparatesZeroFromO) {
  // The classifier prefers letters at positions of digits, and digits at positions of letters.
  const cv::Mat rows = confident_columns("1204BCD", {{2, {{'O', 0.7F}, {'0', 0.2F}}},
                                                     {0, {{'I', 0.9F}, {'1', 0.05F}}},
                                                     {4, {{'8', 0.9F}, {'B', 0.05F}}}});
  const auto spain = decode(rows, choice_of(kSpain), {});
  ASSERT_FALSE(spain.empty());
  EXPECT_EQ(spain[0].text, "1204BCD");
  EXPECT_EQ(spain[0].country, "es");
  EXPECT_EQ(spain[0].layout, 0);
  // The confidence of a symbol compares the symbols that the layout allows there. It does not allow
  // the letter O.
  EXPECT_GT(spain[0].confidences[2], 0.6);

  CountryChoice free;
  free.free_text = true;
  const auto any = decode(rows, free, {});
  ASSERT_FALSE(any.empty());
  EXPECT_EQ(any[0].text, "I2O48CD");
  EXPECT_EQ(any[0].country, "");
  EXPECT_EQ(any[0].layout, -1);
}

TEST(DecodeTest, FreeTextWinsOnlyAtHighProbability) {
  const CountryChoice choice = choice_of(kSpain, true);
  const auto uncertain = confident_columns("1234BCD", {{3, {{'A', 0.6F}, {'4', 0.3F}}}});
  EXPECT_EQ(decode(uncertain, choice, {})[0].text, "1234BCD");
  const auto certain = confident_columns("123ABCD", {{3, {{'A', 0.99F}, {'4', 1e-5F}}}});
  const auto texts = decode(certain, choice, {});
  EXPECT_EQ(texts[0].text, "123ABCD");
  EXPECT_EQ(texts[0].country, "");
  // Free texts keep to the requested lengths.
  DecodeOptions options;
  options.min_length = 8;
  for (const DecodedText& text : decode(certain, choice, options)) {
    EXPECT_TRUE(text.text.size() >= 8 || text.country == "es") << text.text;
  }
}

TEST(DecodeTest, EqualNeighboursNeedABlank) {
  const CountryChoice choice = choice_of("DDD?\n");
  const auto text_of = [&](const cv::Mat& columns) { return decode(columns, choice, {})[0].text; };
  EXPECT_EQ(text_of(columns_of({{{'1', 0.9F}}, {{'1', 0.9F}}, {}, {{'2', 0.9F}}})), "12");
  EXPECT_EQ(text_of(columns_of({{{'1', 0.9F}}, {}, {{'1', 0.9F}}, {}, {{'2', 0.9F}}})), "112");
}

TEST(DecodeTest, DirectTransitionsDoNotSplitACharacter) {
  // An O whose second half looks like a 0, before two digits.
  const cv::Mat columns = columns_of({{{'B', 0.9F}},
                                      {},
                                      {{'O', 0.6F}, {'0', 0.4F}},
                                      {{'O', 0.45F}, {'0', 0.55F}},
                                      {},
                                      {{'6', 0.9F}},
                                      {},
                                      {{'2', 0.9F}}});
  const CountryChoice choice = choice_of("LLDD weight 1\nLLDDD weight 20\n");
  EXPECT_EQ(decode(columns, choice, {})[0].text, "BO62");
}

TEST(DecodeTest, CandidatesAreSortedAndSumToOne) {
  const auto texts = decode(confident_columns("1234BCD", {{1, {{'2', 0.6F}, {'7', 0.39F}}}}),
                            choice_of(kSpain), {});
  ASSERT_GE(texts.size(), 2U);
  EXPECT_EQ(texts[0].text, "1234BCD");
  EXPECT_EQ(texts[1].text, "1734BCD");
  EXPECT_NEAR(texts[0].posterior / texts[1].posterior, 0.6 / 0.39, 0.05);
  double sum = 0;
  for (const DecodedText& text : texts) sum += text.posterior;
  EXPECT_LE(sum, 1 + 1e-9);
  EXPECT_GT(sum, 0.95);
  EXPECT_NEAR(texts[0].confidences[1], 0.6, 0.02);
  EXPECT_GT(texts[0].confidences[0], 0.95);
}

TEST(DecodeTest, ColumnsLocateEachCharacter) {
  const auto texts = decode(confident_columns("1234BCD"), choice_of(kSpain), {});
  ASSERT_EQ(texts[0].columns.size(), 7U);
  for (int k = 0; k < 7; ++k) {
    EXPECT_EQ(texts[0].columns[static_cast<std::size_t>(k)], std::pair(2 * k, 2 * k));
  }
}

TEST(DecodeTest, WideSearchFindsAFaintCharacterOfTheLayout) {
  // The third digit has a very low probability, below the beam of the first search.
  const cv::Mat rows = confident_columns("1234BCD", {{2, {{'3', 3e-6F}, {'5', 1e-6F}}}});
  cv::Mat faint = rows.clone();
  faint.row(5) = 0;
  faint.at<float>(5, kBlank) = 1;
  const auto texts = decode(faint, choice_of(kSpain), {});
  ASSERT_FALSE(texts.empty());
  EXPECT_EQ(texts[0].text, "1234BCD");
  EXPECT_LT(texts[0].confidences[2], 0.01);
}

TEST(DecodeTest, FreeTextsDoNotDisplaceLayoutsInTheBeam) {
  // Each digit is more likely a letter, so free texts always lead.
  std::vector<std::pair<std::size_t, Column>> changes;
  for (std::size_t k = 0; k < 4; ++k) {
    changes.push_back({k, {{'O', 0.3F}, {'Q', 0.3F}, {'D', 0.25F}, {'0', 0.1F}}});
  }
  DecodeOptions options;
  options.beam = 4;
  options.free_penalty = 20;
  EXPECT_EQ(decode(confident_columns("0000BCD", changes), choice_of(kSpain, true), options)[0].text,
            "0000BCD");
}

TEST(DecodeTest, FrequentLayoutsAreMoreProbable) {
  const cv::Mat rows = confident_columns("1234", {{3, {{'B', 0.49F}, {'8', 0.49F}}}});
  DecodeOptions options;
  options.specificity = 0;
  EXPECT_EQ(decode(rows, choice_of("DDDD weight 9\nDDDL weight 1\n"), options)[0].text, "1238");
  EXPECT_EQ(decode(rows, choice_of("DDDD weight 1\nDDDL weight 9\n"), options)[0].text, "123B");
}

TEST(DecodeTest, ReturnsNoneIfNoLayoutFits) {
  EXPECT_TRUE(decode(columns_of({{{'A', 0.9F}}, {}}), choice_of("DDDD\n"), {}).empty());
  EXPECT_TRUE(decode(columns_of({{}, {}, {}}), choice_of(kSpain), {}).empty());
}

TEST(DecodeTest, RejectsInvalidProbabilities) {
  const CountryChoice choice = choice_of(kSpain);
  EXPECT_THROW((void)decode(cv::Mat(), choice, {}), std::invalid_argument);
  EXPECT_THROW((void)decode(cv::Mat(0, kClasses, CV_32F), choice, {}), std::invalid_argument);
  EXPECT_THROW((void)decode(cv::Mat(3, 36, CV_32F, cv::Scalar(0)), choice, {}),
               std::invalid_argument);
  cv::Mat rows = confident_columns("1234BCD");
  rows.at<float>(3, 3) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW((void)decode(rows, choice, {}), std::invalid_argument);
  rows.at<float>(3, 3) = 0.5F;
  EXPECT_THROW((void)decode(rows, choice, {}), std::invalid_argument);
  EXPECT_THROW((void)decode(confident_columns("1"), CountryChoice{}, {}), std::invalid_argument);
  DecodeOptions options;
  options.beam = 3;
  EXPECT_THROW((void)decode(confident_columns("1"), choice, options), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::plate
