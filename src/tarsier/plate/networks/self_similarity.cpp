// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/self_similarity.h"

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

constexpr std::size_t kMinTextCharacters = 4;  // shorter texts are not changed

bool is_narrow(char symbol) { return symbol == '1' || symbol == 'I' || symbol == 'J'; }

// Features of the column nearest to a character's centre.
cv::Mat features_at(const LineData& line, float center) {
  return line.features.row(std::clamp(cvRound(center), 0, line.features.rows - 1));
}

double cosine_similarity(const cv::Mat& a, const cv::Mat& b) {
  return a.dot(b) / (cv::norm(a) * cv::norm(b) + 1e-9);
}

// Evidence for each symbol at position `i`, nats; 0 for symbols that were not read confidently
// elsewhere.
std::array<double, kBlank> similarity_evidence(const LineData& line, const AlignedText& text,
                                               const std::vector<float>& centers, std::size_t i) {
  // Logistic regression on 1071 uncertain characters of synthetic plates with one confidently read
  // symbol of the two.
  constexpr double kMinConfidence = 0.95;
  constexpr double kSimilarityWeight = 1.18;
  constexpr double kNeutralSimilarity = 1.31 / 1.18;
  std::array<double, kBlank> result{};
  std::array<std::optional<double>, kBlank> best;
  const cv::Mat own = features_at(line, centers[i]);
  for (std::size_t j = 0; j < centers.size(); ++j) {
    if (j == i || text.confidences[j] < kMinConfidence) continue;
    auto& similarity = best[static_cast<std::size_t>(class_of(text.text[j]))];
    similarity =
        std::max(similarity.value_or(-1), cosine_similarity(own, features_at(line, centers[j])));
  }
  for (std::size_t symbol = 0; symbol < result.size(); ++symbol)
    if (best[symbol]) result[symbol] = kSimilarityWeight * (*best[symbol] - kNeutralSimilarity);
  return result;
}

// Evidence for a character at position `i` against none, nats.
double character_evidence(const std::vector<double>& edge_energy, std::size_t i) {
  // Logistic regression on the characters read on synthetic plates; 2 % of them are at places
  // without a character.
  constexpr double kEdgeWeight = 1.05;
  constexpr double kInnerBias = 0.4;
  constexpr double kEndBias = -0.5;
  const bool at_end = i == 0 || i + 1 == edge_energy.size();
  return kEdgeWeight * std::min(0.0, edge_energy[i]) + (at_end ? kEndBias : kInnerBias);
}

}  // namespace

std::vector<float> character_centers(const cv::Mat& probabilities,
                                     const std::vector<std::pair<int, int>>& columns) {
  std::vector<float> centers;
  for (const auto& [first, last] : columns) {
    float sum = 0;
    float weights = 0;
    for (int column = first; column <= last; ++column) {
      const float weight = 1 - probabilities.at<float>(column, kBlank) + 1e-6F;
      sum += weight * static_cast<float>(column);
      weights += weight;
    }
    centers.push_back(sum / weights);
  }
  return centers;
}

std::vector<double> relative_edge_energy(const cv::Mat& canvas, const std::string& text,
                                         const std::vector<float>& centers) {
  TARSIER_REQUIRE(text.size() >= 2 && centers.size() == text.size(), "'{}' has {} middles", text,
                  centers.size());
  std::vector<double> distances;
  for (std::size_t k = 1; k < centers.size(); ++k)
    distances.push_back(kColumnStride * static_cast<double>(centers[k] - centers[k - 1]));
  const int reach = std::max(3, cvRound(0.45 * upper_median(distances)));
  cv::Mat smooth;
  canvas.convertTo(smooth, CV_32F);
  cv::GaussianBlur(smooth, smooth, {}, 0.7);
  std::vector<double> energy;
  for (const float center : centers) {
    const int x = cvRound((center + 0.5F) * kColumnStride - 0.5F);
    double sum = 1;
    for (int y = kLineTop - 1; y <= kLineBottom; ++y) {
      const auto* row = smooth.ptr<float>(y);
      for (int c = std::max(1, x - reach); c <= std::min(smooth.cols - 2, x + reach); ++c) {
        const auto slope = static_cast<double>(row[c + 1] - row[c - 1]);
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

cv::Mat refine_by_self_similarity(const LineData& line, const AlignedText& text) {
  TARSIER_REQUIRE(
      text.confidences.size() == text.text.size() && text.columns.size() == text.text.size(),
      "'{}' has {} confidences, {} places", text.text, text.confidences.size(),
      text.columns.size());
  cv::Mat result = line.probabilities.clone();
  if (text.text.size() < kMinTextCharacters) return result;
  const std::vector<float> centers = character_centers(line.probabilities, text.columns);
  const std::vector<double> edge_energy = relative_edge_energy(line.canvas, text.text, centers);
  for (std::size_t i = 0; i < text.text.size(); ++i) {
    const auto [first, last] = text.columns[i];
    // The weight is distributed over all columns of a character.
    const double share = 1.0 / (last - first + 1);
    const double character = share * character_evidence(edge_energy, i);
    const std::array<double, kBlank> similarity = similarity_evidence(line, text, centers, i);
    for (int column = first; column <= last; ++column) {
      auto* row = result.ptr<float>(column);
      float sum = row[kBlank];
      for (std::size_t symbol = 0; symbol < similarity.size(); ++symbol)
        sum += row[symbol] *= static_cast<float>(std::exp(character + share * similarity[symbol]));
      for (int k = 0; k < kClasses; ++k) row[k] /= sum;
    }
  }
  return result;
}

}  // namespace tarsier::plate
