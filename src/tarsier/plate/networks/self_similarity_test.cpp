// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/self_similarity.h"

#include "tarsier/plate/networks/networks.h"
#include "tarsier/plate/text/decode.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <stdexcept>

namespace tarsier::plate {
namespace {

constexpr int kLineColumns = kLineWidth / kColumnStride;
constexpr int kPitch = 6;  // columns
constexpr int kFirst = 5;

// A line whose characters are upright bars of `contrast` grey levels. Each is read as its symbol
// with probability `confidence`, else as `other`. The features are given, one for each character.
struct Bars {
  LineData line;
  AlignedText text;

  void add(char symbol, int contrast, float confidence, char other, int feature) {
    const int position = static_cast<int>(text.text.size());
    const int center = kFirst + kPitch * position;
    if (position == 0) {
      line.canvas = cv::Mat(kLineHeight, kLineWidth, CV_8UC1, cv::Scalar(200));
      line.features = cv::Mat(kLineColumns, 4, CV_32F, cv::Scalar(0));
      line.probabilities = cv::Mat(kLineColumns, kClasses, CV_32F, cv::Scalar(0));
      line.probabilities.col(kBlank).setTo(1);
    }
    const int x = center * kColumnStride;
    cv::rectangle(line.canvas, cv::Rect(x - 5, kLineTop, 10, kLineBottom - kLineTop),
                  cv::Scalar(200 - contrast), cv::FILLED);
    for (int column = center - 1; column <= center; ++column) {
      line.features.at<float>(column, feature) = 1;
      line.probabilities.at<float>(column, kBlank) = 0;
      line.probabilities.at<float>(column, class_of(symbol)) = confidence;
      line.probabilities.at<float>(column, class_of(other)) = 1 - confidence;
    }
    text.text += symbol;
    text.confidences.push_back(static_cast<double>(confidence));
    text.columns.emplace_back(center - 1, center);
  }
  [[nodiscard]] cv::Mat refined() const { return refine_by_self_similarity(line, text); }
  [[nodiscard]] int column(int position) const {
    return text.columns[static_cast<std::size_t>(position)].first;
  }
};

Bars five(int contrast_of_third) {
  Bars bars;
  for (int k = 0; k < 5; ++k) bars.add('A', k == 2 ? contrast_of_third : 150, 0.6F, 'B', 0);
  return bars;
}

TEST(SelfSimilarity, FaintCharacterHasLowRelativeEdgeEnergy) {
  const Bars bars = five(40);
  const std::vector<float> centers = character_centers(bars.line.probabilities, bars.text.columns);
  EXPECT_NEAR(centers[2], kFirst + 2 * kPitch - 0.5F, 1e-3);
  const std::vector<double> energy =
      relative_edge_energy(bars.line.canvas, bars.text.text, centers);
  EXPECT_LT(energy[2], -2);
  EXPECT_NEAR(energy[1], 0, 0.1);
}

TEST(SelfSimilarity, BlankIsMoreProbableAtFaintEdges) {
  Bars faint = five(40);
  Bars strong = five(150);
  for (Bars* bars : {&faint, &strong}) {
    for (int position = 0; position < 5; ++position) {
      for (int side = 0; side < 2; ++side) {
        auto* row = bars->line.probabilities.ptr<float>(bars->column(position) + side);
        row[class_of('A')] = 0.5F;
        row[class_of('B')] = 0.2F;
        row[kBlank] = 0.3F;
      }
    }
  }
  const auto blank = [](const Bars& bars, int position) {
    return bars.refined().at<float>(bars.column(position), kBlank);
  };
  EXPECT_GT(blank(faint, 2), 0.5F);
  EXPECT_LT(blank(strong, 2), 0.3F);
  EXPECT_GT(blank(strong, 0), blank(strong, 1));  // ends most often contain no character
}

TEST(SelfSimilarity, UncertainSymbolBecomesTheMostSimilarOne) {
  Bars bars;
  bars.add('D', 150, 0.99F, 'A', 0);
  bars.add('D', 150, 0.52F, 'O', 1);  // its appearance is that of the O, not of the D
  bars.add('O', 150, 0.99F, 'A', 1);
  bars.add('E', 150, 0.99F, 'A', 2);
  const cv::Mat result = bars.refined();
  const auto* row = result.ptr<float>(bars.column(1));
  EXPECT_GT(row[class_of('O')], row[class_of('D')]);
  // Symbols that occur only once give no information.
  bars.text.text[2] = 'K';
  bars.text.text[0] = 'L';
  const cv::Mat alone = bars.refined();
  EXPECT_GT(alone.at<float>(bars.column(1), class_of('D')),
            alone.at<float>(bars.column(1), class_of('O')));
}

TEST(SelfSimilarity, ColumnsSumToOne) {
  const cv::Mat result = five(60).refined();
  ASSERT_EQ(result.size(), cv::Size(kClasses, kLineColumns));
  for (int column = 0; column < result.rows; ++column)
    EXPECT_NEAR(cv::sum(result.row(column))[0], 1, 1e-5);
}

TEST(SelfSimilarity, TextsOfThreeCharactersAreUnchanged) {
  Bars bars;
  for (int k = 0; k < 3; ++k) bars.add('A', k == 1 ? 30 : 150, 0.6F, 'B', 0);
  EXPECT_EQ(cv::norm(bars.refined(), bars.line.probabilities, cv::NORM_INF), 0);
}

TEST(SelfSimilarity, RejectsTextsWithoutColumns) {
  Bars bars = five(100);
  bars.text.columns.pop_back();
  EXPECT_THROW((void)bars.refined(), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::plate
