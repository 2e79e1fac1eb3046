// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <string>
#include <utility>
#include <vector>

// Compares the characters of one plate with each other. All characters of a plate have the same
// typeface and the same ink. A seal between two groups has other edges than the characters. A
// doubtful symbol should look like the same symbol elsewhere on the plate.
namespace tarsier::plate {

// A line of one row, as input and output of the networks.
struct LineData {
  cv::Mat canvas;         // kLineHeight x kLineWidth, CV_8UC1
  cv::Mat features;       // columns x planes, CV_32F: from read_line()
  cv::Mat probabilities;  // columns x kClasses, CV_32F
};

// The decoded text that is compared with itself.
struct AlignedText {
  std::string text;
  std::vector<double> confidences;           // 0..1
  std::vector<std::pair<int, int>> columns;  // first and last of each character
};

// Centres of the characters, in columns: the mean of each character's columns, weighted by the
// probability that the column is not blank.
[[nodiscard]] std::vector<float> character_centers(const cv::Mat& probabilities,
                                                   const std::vector<std::pair<int, int>>& columns);

// For each character, ln(E / median E of the others). E is the energy of the vertical edges around
// the character's centre: the sum of squared derivatives along the line, in the canvas smoothed by
// 0.7 px, within 0.45 of the median distance between neighbours. The median excludes 1, I and J,
// which have few edges, unless there is no other character. `text` has at least 2 characters.
[[nodiscard]] std::vector<double> relative_edge_energy(const cv::Mat& canvas,
                                                       const std::string& text,
                                                       const std::vector<float>& centers);

// Revises the line's probabilities by the whole text; each column still sums to 1. If a character
// has fainter edges than the others, or stands at an end, its blank becomes more likely. For a
// doubtful character, symbols that look like a confidently read symbol elsewhere become more
// likely, and symbols that look different become less likely. Texts of fewer than 4 characters are
// not changed.
[[nodiscard]] cv::Mat refine_by_self_similarity(const LineData& line, const AlignedText& text);

}  // namespace tarsier::plate
