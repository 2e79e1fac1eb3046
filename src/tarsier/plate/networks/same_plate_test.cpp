// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/same_plate.h"

#include "tarsier/plate/networks/networks.h"
#include "tarsier/plate/text/decode.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <stdexcept>

namespace tarsier::plate {
namespace {

constexpr int kColumns = kLineWidth / kColumn;
constexpr int kPitch = 6;  // columns
constexpr int kFirst = 5;

// A line whose characters are upright bars of `contrast` grey levels. Each is read as its symbol
// with probability `sure`, else as `other`. The features are given, one for each character.
struct Bars {
  SeenLine line;
  LetteredText text;

  void add(char symbol, int contrast, float sure, char other, int feature) {
    const int place = static_cast<int>(text.text.size());
    const int middle = kFirst + kPitch * place;
    if (place == 0) {
      line.canvas = cv::Mat(kLineHeight, kLineWidth, CV_8UC1, cv::Scalar(200));
      line.features = cv::Mat(kColumns, 4, CV_32F, cv::Scalar(0));
      line.probabilities = cv::Mat(kColumns, kClasses, CV_32F, cv::Scalar(0));
      line.probabilities.col(kBlank).setTo(1);
    }
    const int x = middle * kColumn;
    cv::rectangle(line.canvas, cv::Rect(x - 5, kLineTop, 10, kLineBottom - kLineTop),
                  cv::Scalar(200 - contrast), cv::FILLED);
    for (int column = middle - 1; column <= middle; ++column) {
      line.features.at<float>(column, feature) = 1;
      line.probabilities.at<float>(column, kBlank) = 0;
      line.probabilities.at<float>(column, class_of(symbol)) = sure;
      line.probabilities.at<float>(column, class_of(other)) = 1 - sure;
    }
    text.text += symbol;
    text.confidences.push_back(static_cast<double>(sure));
    text.columns.emplace_back(middle - 1, middle);
  }
  [[nodiscard]] cv::Mat compared() const { return compared_with_itself(line, text); }
  [[nodiscard]] int column(int place) const {
    return text.columns[static_cast<std::size_t>(place)].first;
  }
};

Bars five(int contrast_of_third) {
  Bars bars;
  for (int k = 0; k < 5; ++k) bars.add('A', k == 2 ? contrast_of_third : 150, 0.6F, 'B', 0);
  return bars;
}

TEST(SamePlate, FaintEdgesAreNoCharacterOfThePlate) {
  const Bars bars = five(40);
  const std::vector<float> middles = middles_of(bars.line.probabilities, bars.text.columns);
  EXPECT_NEAR(middles[2], kFirst + 2 * kPitch - 0.5F, 1e-3);
  const std::vector<double> ink = relative_ink(bars.line.canvas, bars.text.text, middles);
  EXPECT_LT(ink[2], -2);
  EXPECT_NEAR(ink[1], 0, 0.1);
}

TEST(SamePlate, ABlankIsLikelierThereThanWhereEdgesAreAsStrong) {
  Bars faint = five(40);
  Bars strong = five(150);
  for (Bars* bars : {&faint, &strong}) {
    for (int place = 0; place < 5; ++place) {
      for (int side = 0; side < 2; ++side) {
        auto* row = bars->line.probabilities.ptr<float>(bars->column(place) + side);
        row[class_of('A')] = 0.5F;
        row[class_of('B')] = 0.2F;
        row[kBlank] = 0.3F;
      }
    }
  }
  const auto blank = [](const Bars& bars, int place) {
    return bars.compared().at<float>(bars.column(place), kBlank);
  };
  EXPECT_GT(blank(faint, 2), 0.5F);
  EXPECT_LT(blank(strong, 2), 0.3F);
  EXPECT_GT(blank(strong, 0), blank(strong, 1));  // ends most often contain no character
}

TEST(SamePlate, ADoubtfulSymbolIsWhatItLooksLikeElsewhere) {
  Bars bars;
  bars.add('D', 150, 0.99F, 'A', 0);
  bars.add('D', 150, 0.52F, 'O', 1);  // its appearance is that of the O, not of the D
  bars.add('O', 150, 0.99F, 'A', 1);
  bars.add('E', 150, 0.99F, 'A', 2);
  const cv::Mat result = bars.compared();
  const auto* row = result.ptr<float>(bars.column(1));
  EXPECT_GT(row[class_of('O')], row[class_of('D')]);
  // Symbols that occur only once give no information.
  bars.text.text[2] = 'K';
  bars.text.text[0] = 'L';
  const cv::Mat alone = bars.compared();
  EXPECT_GT(alone.at<float>(bars.column(1), class_of('D')),
            alone.at<float>(bars.column(1), class_of('O')));
}

TEST(SamePlate, ColumnsAddUpToOne) {
  const cv::Mat result = five(60).compared();
  ASSERT_EQ(result.size(), cv::Size(kClasses, kColumns));
  for (int column = 0; column < result.rows; ++column)
    EXPECT_NEAR(cv::sum(result.row(column))[0], 1, 1e-5);
}

TEST(SamePlate, ThreeCharactersTellNothing) {
  Bars bars;
  for (int k = 0; k < 3; ++k) bars.add('A', k == 1 ? 30 : 150, 0.6F, 'B', 0);
  EXPECT_EQ(cv::norm(bars.compared(), bars.line.probabilities, cv::NORM_INF), 0);
}

TEST(SamePlate, TextsWithoutPlacesAreRefused) {
  Bars bars = five(100);
  bars.text.columns.pop_back();
  EXPECT_THROW((void)bars.compared(), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::plate
