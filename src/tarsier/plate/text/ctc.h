// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <limits>
#include <utility>
#include <vector>

// The two passes over the alignments of a text with columns of class probabilities (Graves et al.,
// ICML 2006, section 4): the probability of the text, and its best single alignment. States
// alternate between blanks and characters: blank, first, blank, second ... blank.
namespace tarsier::plate {

// Weight of a character that follows another one without a blank between them; the paper uses 1.
// The network is trained with blanks on both sides of each character's middle, so a direct change
// is mostly one character read as two (an O as "O0").
inline constexpr double kDirectTransitionWeight = 0.001;

inline constexpr double kLogZero = -std::numeric_limits<double>::infinity();

// Natural logarithm of the probability that the columns show `classes` (numbers below kBlank). The
// columns are the rows of `probabilities`, CV_32F, kClasses wide. The result is minus infinity if
// the classes do not fit into the columns.
[[nodiscard]] double log_probability(const cv::Mat& probabilities, const std::vector<int>& classes);

// First and last column of each character in the most probable alignment. Empty if no alignment is
// possible.
[[nodiscard]] std::vector<std::pair<int, int>> best_alignment(const cv::Mat& probabilities,
                                                              const std::vector<int>& classes);

}  // namespace tarsier::plate
