// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <string>
#include <utility>
#include <vector>

// What the characters of one plate tell of each other: they are lettered with the same dies and the same
// ink. A seal between two groups has other edges than they, and a symbol that is doubtful looks like the
// same symbol elsewhere on the plate.
namespace tarsier::plate {

// A line of one row as the networks see it.
struct SeenLine {
  cv::Mat canvas;         // kLineHeight x kLineWidth, CV_8UC1
  cv::Mat features;       // columns x planes, CV_32F: of read_line()
  cv::Mat probabilities;  // columns x kClasses, CV_32F
};

// The text that is compared with itself, as the decoder gave it.
struct LetteredText {
  std::string text;
  std::vector<double> confidences;           // 0..1
  std::vector<std::pair<int, int>> columns;  // first and last of each character
};

// Middles of the characters in columns: the mean of their columns, each weighed by its chance of being no
// blank.
[[nodiscard]] std::vector<float> middles_of(const cv::Mat& probabilities,
                                            const std::vector<std::pair<int, int>>& columns);

// For each character ln(E / median E of the others), of the energy E of the upright edges around its
// middle: the sum of squared derivatives along the line of the canvas smoothed by 0.7 px, within 0.45 of
// the median distance between neighbours. 1, I and J, which have few edges, do not count among the others
// unless there is nothing else. `text` has 2 characters and more.
[[nodiscard]] std::vector<double> relative_ink(const cv::Mat& canvas, const std::string& text,
                                               const std::vector<float>& middles);

// The line's probabilities in the light of the whole text, each column adding up to 1 again: where a
// character has fainter edges than the others, or stands at an end, a blank becomes more likely; where
// it is doubtful, a symbol that looks as one that was read surely elsewhere becomes likelier, and one that
// does not less so. Texts of fewer than 4 characters tell nothing.
[[nodiscard]] cv::Mat compared_with_itself(const SeenLine& line, const LetteredText& text);

}  // namespace tarsier::plate
