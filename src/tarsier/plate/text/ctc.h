// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <utility>
#include <vector>

// The two sums over alignments of a text with columns of class probabilities (Graves et al., ICML
// 2006, section 4): the text's probability and its best single alignment. States alternate between
// blanks and characters: blank, first, blank, second ... blank.
namespace tarsier::plate {

// Weight of a character that follows another without a blank between them, against 1 in the paper.
// The columns are learnt with blanks around each character's middle, so such a change is mostly one
// character that is seen as two (an O as "O0").
inline constexpr double kDirect = 0.001;

// Natural logarithm of the probability that `classes` (numbers below kBlank) stand in the columns
// (rows of `probabilities`, CV_32F, kClasses wide); minus infinity where they cannot.
[[nodiscard]] double log_probability(const cv::Mat& probabilities, const std::vector<int>& classes);

// First and last column of each character in the most probable alignment; empty where none is
// possible.
[[nodiscard]] std::vector<std::pair<int, int>> best_alignment(const cv::Mat& probabilities,
                                                              const std::vector<int>& classes);

}  // namespace tarsier::plate
