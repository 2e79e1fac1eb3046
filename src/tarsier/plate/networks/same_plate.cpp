// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/same_plate.h"

#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/plate/networks/networks.h"
#include "tarsier/plate/text/decode.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>

namespace tarsier::plate {
namespace {

constexpr std::size_t kTelling = 4;  // minimum number of characters

bool is_narrow(char symbol) { return symbol == '1' || symbol == 'I' || symbol == 'J'; }

// Features of the column nearest to a character's centre.
cv::Mat features_at(const SeenLine& line, float middle) {
  return line.features.row(std::clamp(cvRound(middle), 0, line.features.rows - 1));
}

double likeness(const cv::Mat& a, const cv::Mat& b) {
  return a.dot(b) / (cv::norm(a) * cv::norm(b) + 1e-9);
}

// Evidence for each symbol at place `i`, nats; 0 for symbols that were not read confidently
// elsewhere.
std::array<double, kBlank> likenesses(const SeenLine& line, const LetteredText& text,
                                      const std::vector<float>& middles, std::size_t i) {
  // Logistic regression on 1071 doubtful places of synthetic plates with one confidently read
  // symbol of the two.
  constexpr double kSure = 0.95;
  constexpr double kLike = 1.18;
  constexpr double kUsual = 1.31 / 1.18;
  std::array<double, kBlank> result{};
  std::array<std::optional<double>, kBlank> best;
  const cv::Mat own = features_at(line, middles[i]);
  for (std::size_t j = 0; j < middles.size(); ++j) {
    if (j == i || text.confidences[j] < kSure) continue;
    auto& like = best[static_cast<std::size_t>(class_of(text.text[j]))];
    like = std::max(like.value_or(-1), likeness(own, features_at(line, middles[j])));
  }
  for (std::size_t symbol = 0; symbol < result.size(); ++symbol)
    if (best[symbol]) result[symbol] = kLike * (*best[symbol] - kUsual);
  return result;
}

// Evidence for a character at place `i` against none, nats.
double character_evidence(const std::vector<double>& ink, std::size_t i) {
  // Logistic regression on the characters read on synthetic plates; 2 % of them are at places
  // without a character.
  constexpr double kInk = 1.05;
  constexpr double kInner = 0.4;
  constexpr double kEnd = -0.5;
  const bool at_end = i == 0 || i + 1 == ink.size();
  return kInk * std::min(0.0, ink[i]) + (at_end ? kEnd : kInner);
}

}  // namespace

std::vector<float> middles_of(const cv::Mat& probabilities,
                              const std::vector<std::pair<int, int>>& columns) {
  std::vector<float> middles;
  for (const auto& [first, last] : columns) {
    float sum = 0;
    float weights = 0;
    for (int column = first; column <= last; ++column) {
      const float weight = 1 - probabilities.at<float>(column, kBlank) + 1e-6F;
      sum += weight * static_cast<float>(column);
      weights += weight;
    }
    middles.push_back(sum / weights);
  }
  return middles;
}

std::vector<double> relative_ink(const cv::Mat& canvas, const std::string& text,
                                 const std::vector<float>& middles) {
  TARSIER_REQUIRE(text.size() >= 2 && middles.size() == text.size(), "'{}' has {} middles", text,
                  middles.size());
  std::vector<double> distances;
  for (std::size_t k = 1; k < middles.size(); ++k)
    distances.push_back(kColumn * static_cast<double>(middles[k] - middles[k - 1]));
  const int reach = std::max(3, cvRound(0.45 * upper_median(distances)));
  cv::Mat smooth;
  canvas.convertTo(smooth, CV_32F);
  cv::GaussianBlur(smooth, smooth, {}, 0.7);
  std::vector<double> energy;
  for (const float middle : middles) {
    const int x = cvRound((middle + 0.5F) * kColumn - 0.5F);
    double sum = 1;
    for (int y = kLineTop - 1; y <= kLineBottom; ++y) {
      const auto* row = smooth.ptr<float>(y);
      for (int c = std::max(1, x - reach); c <= std::min(smooth.cols - 2, x + reach); ++c) {
        const double slope = static_cast<double>(row[c + 1] - row[c - 1]);
        sum += slope * slope;
      }
    }
    energy.push_back(std::log(sum));
  }
  std::vector<double> result;
  for (std::size_t i = 0; i < energy.size(); ++i) {
    std::vector<double> others;
    for (const bool narrow : {false, true}) {
      for (std::size_t j = 0; j < energy.size() && (!narrow || others.empty()); ++j)
        if (j != i && (narrow || !is_narrow(text[j]))) others.push_back(energy[j]);
    }
    result.push_back(energy[i] - upper_median(others));
  }
  return result;
}

cv::Mat compared_with_itself(const SeenLine& line, const LetteredText& text) {
  TARSIER_REQUIRE(
      text.confidences.size() == text.text.size() && text.columns.size() == text.text.size(),
      "'{}' has {} confidences, {} places", text.text, text.confidences.size(),
      text.columns.size());
  cv::Mat result = line.probabilities.clone();
  if (text.text.size() < kTelling) return result;
  const std::vector<float> middles = middles_of(line.probabilities, text.columns);
  const std::vector<double> ink = relative_ink(line.canvas, text.text, middles);
  for (std::size_t i = 0; i < text.text.size(); ++i) {
    const auto [first, last] = text.columns[i];
    // The weight is distributed over all columns of a character.
    const double share = 1.0 / (last - first + 1);
    const double character = share * character_evidence(ink, i);
    const std::array<double, kBlank> like = likenesses(line, text, middles, i);
    for (int column = first; column <= last; ++column) {
      auto* row = result.ptr<float>(column);
      float sum = row[kBlank];
      for (std::size_t symbol = 0; symbol < like.size(); ++symbol)
        sum += row[symbol] *= static_cast<float>(std::exp(character + share * like[symbol]));
      for (int k = 0; k < kClasses; ++k) row[k] /= sum;
    }
  }
  return result;
}

}  // namespace tarsier::plate
