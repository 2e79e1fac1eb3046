// SPDX-License-Identifier: MIT
#include "tarsier/plate/text/decode.h"

#include "tarsier/core/require.h"
#include "tarsier/plate/text/beam_search.h"
#include "tarsier/plate/text/ctc.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace tarsier::plate {
void DecodeOptions::check() const {
  check_fields(*this);
  static_assert(kMaxPositions == 12);  // the upper limit in fields()
  TARSIER_REQUIRE(min_length <= max_length, "lengths {}..{}", min_length, max_length);
}

namespace {

std::vector<int> classes_of(const std::string& text) {
  std::vector<int> classes;
  for (const char symbol : text) classes.push_back(class_of(symbol));
  return classes;
}

void sort_best_first(std::vector<DecodedText>& texts) {
  std::sort(texts.begin(), texts.end(), [](const DecodedText& a, const DecodedText& b) {
    return a.log_score != b.log_score ? a.log_score > b.log_score : a.text < b.text;
  });
}

// Weight of each symbol at each position, given the characters of `classes` before it.
std::vector<std::array<double, kSymbols>> symbol_weights(const Decoder::Tables& tables,
                                                         const std::vector<int>& classes) {
  const double free = tables.choice.free_text ? std::exp(-tables.options.free_penalty) : 0;
  std::vector<std::array<double, kSymbols>> result(classes.size());
  std::vector<std::uint64_t> set(tables.words, ~std::uint64_t{0});
  for (std::size_t position = 0; position < classes.size(); ++position) {
    result[position].fill(free);
    for (int symbol = 0; symbol < kSymbols && position < kMaxPositions; ++symbol) {
      const std::uint64_t* fitting = &tables.fitting[tables.index(position, symbol)];
      bool any = false;
      for (std::size_t word = 0; word < tables.words; ++word)
        any |= (set[word] & fitting[word]) != 0;
      if (any) result[position][static_cast<std::size_t>(symbol)] = 1;
    }
    const std::uint64_t* fitting = &tables.fitting[tables.index(position, classes[position])];
    for (std::size_t word = 0; word < tables.words; ++word) set[word] &= fitting[word];
  }
  return result;
}

void align(DecodedText& text, const Decoder::Tables& tables, const cv::Mat& probabilities) {
  const std::vector<int> classes = classes_of(text.text);
  text.columns = best_alignment(probabilities, classes);
  const auto allowed = symbol_weights(tables, classes);
  for (std::size_t position = 0; position < text.columns.size(); ++position) {
    const auto own = static_cast<std::size_t>(classes[position]);
    double peak = -1;
    double share = 0;
    for (int column = text.columns[position].first; column <= text.columns[position].second;
         ++column) {
      const auto* row = probabilities.ptr<float>(column);
      if (static_cast<double>(row[own]) <= peak) continue;
      peak = static_cast<double>(row[own]);
      auto sum = static_cast<double>(row[kBlank]);
      for (std::size_t symbol = 0; symbol < kSymbols; ++symbol) {
        const double weight = symbol == own ? 1 : allowed[position][symbol];
        sum += weight * static_cast<double>(row[symbol]);
      }
      share = sum > 0 ? peak / sum : 0;
    }
    text.confidences.push_back(std::clamp(share, 0.0, 1.0));
  }
}

void require_probabilities(const cv::Mat& probabilities) {
  TARSIER_REQUIRE(probabilities.dims == 2 && probabilities.rows >= 1 &&
                      probabilities.cols == kClasses && probabilities.type() == CV_32F,
                  "{}x{}, type {} are not class probabilities", probabilities.cols,
                  probabilities.rows, probabilities.type());
  for (int column = 0; column < probabilities.rows; ++column) {
    const auto* row = probabilities.ptr<float>(column);
    double sum = 0;
    for (int k = 0; k < kClasses; ++k) {
      TARSIER_REQUIRE(row[k] >= 0 && row[k] <= 1.001F, "class {} of column {} has probability {}",
                      k, column, row[k]);
      sum += static_cast<double>(row[k]);
    }
    TARSIER_REQUIRE(std::abs(sum - 1) < 0.01, "the probabilities of column {} add up to {}", column,
                    sum);
  }
}

}  // namespace

Decoder::Decoder(CountryChoice choice, const DecodeOptions& options)
    : tables_(std::make_unique<const Tables>(std::move(choice), options)) {}
Decoder::~Decoder() = default;
Decoder::Decoder(Decoder&&) noexcept = default;
Decoder& Decoder::operator=(Decoder&&) noexcept = default;

std::vector<DecodedText> Decoder::decode(const cv::Mat& probabilities) const {
  require_probabilities(probabilities);
  const DecodeOptions& options = tables_->options;
  // The second, wider search is for images in which a character required by the layouts is hardly
  // visible.
  std::vector<DecodedText> texts;
  for (int attempt = 0; attempt < 2 && texts.empty(); ++attempt) {
    texts = search_texts(*tables_, probabilities, attempt > 0);
  }
  sort_best_first(texts);
  // The sums lack the alignments that the beam dropped, so the best texts are summed exactly.
  const std::size_t exact =
      std::min(texts.size(), 2 * static_cast<std::size_t>(options.candidates));
  for (std::size_t k = 0; k < exact; ++k) {
    const double sum = log_probability(probabilities, classes_of(texts[k].text));
    texts[k].log_score += sum - texts[k].acoustic;
    texts[k].acoustic = sum;
  }
  sort_best_first(texts);
  double total = 0;
  for (const DecodedText& text : texts) total += std::exp(text.log_score - texts.front().log_score);
  if (texts.size() > static_cast<std::size_t>(options.candidates)) {
    texts.resize(static_cast<std::size_t>(options.candidates));
  }
  const double best = texts.empty() ? 0 : texts.front().log_score;
  for (DecodedText& text : texts) {
    text.posterior = std::exp(text.log_score - best) / total;
    align(text, *tables_, probabilities);
  }
  return texts;
}

}  // namespace tarsier::plate
