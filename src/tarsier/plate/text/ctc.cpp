// SPDX-License-Identifier: MIT
#include "tarsier/plate/text/ctc.h"

#include "tarsier/plate/text/reading.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace tarsier::plate {
namespace {

int class_of_state(const std::vector<int>& classes, std::size_t state) {
  return state % 2 == 0 ? kBlank : classes[state / 2];
}

// A character may follow the previous one directly, without a blank, if they differ.
bool may_skip_blank(const std::vector<int>& classes, std::size_t state) {
  return state % 2 == 1 && state >= 3 && classes[state / 2] != classes[state / 2 - 1];
}

}  // namespace

double log_probability(const cv::Mat& probabilities, const std::vector<int>& classes) {
  const std::size_t states = 2 * classes.size() + 1;
  std::vector<double> forward(states, 0);
  double log_scale = 0;
  for (int column = 0; column < probabilities.rows; ++column) {
    const auto* row = probabilities.ptr<float>(column);
    double sum = 0;
    for (std::size_t state = states; state-- > 0;) {  // descending, so that one array is enough
      double incoming = forward[state];
      if (column == 0) {
        incoming = state < 2 ? 1 : 0;
      } else {
        if (state >= 1) incoming += forward[state - 1];
        if (may_skip_blank(classes, state))
          incoming += kDirectTransitionWeight * forward[state - 2];
      }
      forward[state] = incoming * static_cast<double>(row[class_of_state(classes, state)]);
      sum += forward[state];
    }
    if (!(sum > 0)) return kLogZero;
    for (double& value : forward) value /= sum;
    log_scale += std::log(sum);
  }
  const double final_probability = forward[states - 1] + (states > 1 ? forward[states - 2] : 0);
  return final_probability > 0 ? log_scale + std::log(final_probability) : kLogZero;
}

std::vector<std::pair<int, int>> best_alignment(const cv::Mat& probabilities,
                                                const std::vector<int>& classes) {
  const std::size_t states = 2 * classes.size() + 1;
  const auto columns = static_cast<std::size_t>(probabilities.rows);
  if (columns == 0) return {};
  static const double log_direct = std::log(kDirectTransitionWeight);
  std::vector<double> score(states, kLogZero);
  std::vector<std::uint8_t> steps(states * columns, 0);  // number of states to go back
  const auto log_of = [](float p) { return p > 0 ? std::log(static_cast<double>(p)) : kLogZero; };
  for (std::size_t column = 0; column < columns; ++column) {
    const auto* row = probabilities.ptr<float>(static_cast<int>(column));
    const double log_blank = log_of(row[kBlank]);
    for (std::size_t state = states; state-- > 0;) {
      double best = score[state];
      std::uint8_t step = 0;
      if (column == 0) {
        best = state < 2 ? 0 : kLogZero;
      } else {
        if (state >= 1 && score[state - 1] > best) {
          best = score[state - 1];
          step = 1;
        }
        if (may_skip_blank(classes, state) && score[state - 2] + log_direct > best) {
          best = score[state - 2] + log_direct;
          step = 2;
        }
      }
      score[state] = best + (state % 2 == 0 ? log_blank : log_of(row[classes[state / 2]]));
      steps[column * states + state] = step;
    }
  }
  std::size_t state = states - 1;
  if (states > 1 && score[states - 2] > score[states - 1]) state = states - 2;
  if (score[state] == kLogZero) return {};
  std::vector<std::pair<int, int>> spans(classes.size(), {-1, -1});
  for (std::size_t column = columns; column-- > 0;) {
    if (state % 2 == 1) {
      auto& [first, last] = spans[state / 2];
      first = static_cast<int>(column);
      if (last < 0) last = first;
    }
    state -= steps[column * states + state];
  }
  return spans;
}

}  // namespace tarsier::plate
