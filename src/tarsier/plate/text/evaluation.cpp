// SPDX-License-Identifier: MIT
#include "tarsier/plate/text/evaluation.h"

#include "tarsier/core/boxes.h"
#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/plate/text/text.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <set>
#include <tuple>

namespace tarsier::plate {
namespace {

// Boxes with less overlap never match, whatever the options are.
constexpr double kMinOverlap = 0.3;

std::string base_name(const std::string& path) { return path.substr(path.rfind('/') + 1); }

std::string normalized(const std::string& text, bool fold) {
  const std::string symbols = plate_symbols(text, true);
  return fold ? fold_symbols(symbols) : symbols;
}

// Number of visible characters of a true text.
int visible_characters(const std::string& text) {
  return static_cast<int>(text.size()) -
         static_cast<int>(std::count(text.begin(), text.end(), '-'));
}

double share(double part, double whole) { return whole > 0 ? part / whole : -1; }

// Sums over all images.
struct Tally {
  PlateScores scores;
  bool fold = false;
  double iou = 0.5;
  int found_at_03 = 0, matched = 0;
  int characters = 0, right_characters = 0, found_characters = 0;
  std::vector<double> right, wrong;  // confidences

  void add_image(const std::string& image, const std::vector<TruthPlate>& truth,
                 const ImageReadings& readings);
  void add_text(const std::string& image, const TruthPlate& plate, const std::string& text,
                const ImageReadings& readings, const Reading* found);
};

cv::Rect2d box_of(const ImageReadings& readings, std::size_t k) {
  return readings.boxes.empty() ? cv::Rect2d(readings.plates[k].box) : readings.boxes[k];
}

// For each plate of the truth: the index of its reading and their overlap.
std::map<std::size_t, std::pair<std::size_t, double>> match(const std::vector<TruthPlate>& truth,
                                                            const std::vector<std::string>& texts,
                                                            const ImageReadings& readings,
                                                            bool fold) {
  std::vector<std::tuple<double, std::size_t, std::size_t>> pairs;
  for (std::size_t a = 0; a < truth.size(); ++a) {
    for (std::size_t b = 0; b < readings.plates.size(); ++b) {
      // A plate without a known box may be any reading: the most similar one is used.
      const double value =
          truth[a].box
              ? iou(*truth[a].box, box_of(readings, b))
              : 1 - edit_distance_to_truth(texts[a], normalized(readings.plates[b].text, fold)) /
                        99.0;
      if (value >= kMinOverlap) pairs.emplace_back(value, a, b);
    }
  }
  std::sort(pairs.rbegin(), pairs.rend());
  std::map<std::size_t, std::pair<std::size_t, double>> matches;
  std::set<std::size_t> used;
  for (const auto& [value, a, b] : pairs) {
    if (matches.contains(a) || used.contains(b)) continue;
    matches[a] = {b, value};
    used.insert(b);
  }
  return matches;
}

void Tally::add_image(const std::string& image, const std::vector<TruthPlate>& truth,
                      const ImageReadings& readings) {
  TARSIER_REQUIRE(readings.boxes.empty() || readings.boxes.size() == readings.plates.size(),
                  "{} boxes for {} plates", readings.boxes.size(), readings.plates.size());
  ++scores.images;
  scores.returned += static_cast<int>(readings.plates.size());
  std::vector<std::string> texts;
  texts.reserve(truth.size());
  for (const TruthPlate& plate : truth) texts.push_back(normalized(plate.text, fold));
  const auto matches = match(truth, texts, readings, fold);
  for (std::size_t k = 0; k < truth.size(); ++k) {
    ++scores.truth;
    const auto found = matches.find(k);
    const bool hit = found != matches.end() && (!truth[k].box || found->second.second >= iou);
    if (truth[k].box) {
      ++scores.boxes;
      scores.found += hit ? 1 : 0;
      found_at_03 += found != matches.end() ? 1 : 0;
    }
    matched += hit ? 1 : 0;
    if (texts[k].empty()) continue;
    add_text(image, truth[k], texts[k], readings,
             hit ? &readings.plates[found->second.first] : nullptr);
  }
}

void Tally::add_text(const std::string& image, const TruthPlate& plate, const std::string& text,
                     const ImageReadings& readings, const Reading* found) {
  const auto edits = [&](const std::string& read) {
    return edit_distance_to_truth(text, normalized(read, fold));
  };
  const auto with_digit_zero = [](std::string symbols) {
    std::replace(symbols.begin(), symbols.end(), 'O', '0');
    return symbols;
  };
  PlateOutcome outcome;
  outcome.image = image;
  outcome.truth = plate;
  outcome.found = found != nullptr;
  outcome.edits = visible_characters(text);
  ++scores.texts;
  characters += visible_characters(text);
  scores.exact_any += std::any_of(readings.plates.begin(), readings.plates.end(),
                                  [&](const Reading& any) { return edits(any.text) == 0; })
                          ? 1
                          : 0;
  if (found != nullptr) {
    outcome.reading = *found;
    outcome.edits = edits(found->text);
    outcome.exact = outcome.edits == 0;
    scores.exact += outcome.exact ? 1 : 0;
    scores.exact_o_as_0 +=
        edit_distance_to_truth(with_digit_zero(text),
                               with_digit_zero(normalized(found->text, fold))) == 0
            ? 1
            : 0;
    right_characters += std::max(0, visible_characters(text) - outcome.edits);
    found_characters += visible_characters(text);
    const auto end = found->candidates.begin() + static_cast<std::ptrdiff_t>(std::min<std::size_t>(
                                                     10, found->candidates.size()));
    const bool among = found->candidates.empty()
                           ? outcome.exact
                           : std::any_of(found->candidates.begin(), end, [&](const Candidate& any) {
                               return edits(any.text) == 0;
                             });
    scores.top10 += among ? 1 : 0;
    (outcome.exact ? right : wrong).push_back(found->confidence);
  }
  scores.outcomes.push_back(std::move(outcome));
}

// Probability that an element of `high` is above one of `low`; ties count half.
double area_under_curve(const std::vector<double>& high, std::vector<double> low) {
  std::sort(low.begin(), low.end());
  double wins = 0;
  for (const double value : high) {
    const auto [first, last] = std::equal_range(low.begin(), low.end(), value);
    wins += static_cast<double>(first - low.begin()) + 0.5 * static_cast<double>(last - first);
  }
  return share(wins, static_cast<double>(high.size()) * static_cast<double>(low.size()));
}

// Sets evaluated, calibration_error, high_confidence and high_confidence_wrong from the confidences
// of correct and wrong texts. Does nothing if a confidence is not in 0..1 (another program's
// percentages).
void add_reliability(const std::vector<double>& right, const std::vector<double>& wrong,
                     PlateScores& scores) {
  constexpr int kBins = 10;
  constexpr double kHighConfidence = 0.9;
  const auto is_probability = [](double value) { return value >= 0 && value <= 1; };
  if (!std::all_of(right.begin(), right.end(), is_probability) ||
      !std::all_of(wrong.begin(), wrong.end(), is_probability)) {
    return;
  }
  std::array<double, kBins> confidence{};
  std::array<int, kBins> correct{}, count{};
  const auto add = [&](double value, bool is_right) {
    const auto bin = static_cast<std::size_t>(std::min(static_cast<int>(value * kBins), kBins - 1));
    confidence[bin] += value;
    correct[bin] += is_right ? 1 : 0;
    ++count[bin];
    if (value <= kHighConfidence) return;
    ++scores.high_confidence;
    scores.high_confidence_wrong += is_right ? 0 : 1;
  };
  for (const double value : right) add(value, true);
  for (const double value : wrong) add(value, false);
  scores.evaluated = static_cast<int>(right.size() + wrong.size());
  double error = 0;
  for (std::size_t bin = 0; bin < kBins; ++bin) error += std::abs(correct[bin] - confidence[bin]);
  scores.calibration_error = share(error, scores.evaluated);
}

void add_times(std::vector<double> times, PlateScores& scores) {
  if (times.empty()) return;
  std::sort(times.begin(), times.end());
  const std::size_t half = times.size() / 2;
  scores.median_ms = times.size() % 2 == 1 ? times[half] : (times[half - 1] + times[half]) / 2;
  scores.p90_ms = times[static_cast<std::size_t>(0.9 * static_cast<double>(times.size() - 1))];
}

// Rounded; null if not known.
nlohmann::ordered_json rounded(double value, int decimals) {
  if (value < 0) return nullptr;
  return std::strtod(fmt::format("{:.{}f}", value, decimals).c_str(), nullptr);
}

nlohmann::ordered_json interval_json(int successes, int trials) {
  if (trials == 0) return nullptr;
  const Interval interval = wilson_interval(successes, trials);
  return {rounded(interval.low, 4), rounded(interval.high, 4)};
}

}  // namespace

PlateScores evaluate_plates(const std::vector<ImageReadings>& readings, const PlateTruth& truth,
                            const EvaluationOptions& options) {
  options.check();
  std::map<std::string, const ImageReadings*> by_name;
  for (const ImageReadings& image : readings) by_name[base_name(image.image)] = &image;
  Tally tally;
  tally.fold = options.fold;
  tally.iou = options.iou;
  std::vector<double> times;
  const ImageReadings nothing{"", -1, {}, {}};
  for (const auto& [image, plates] : truth) {
    const auto found = by_name.find(image);
    const ImageReadings& read = found == by_name.end() ? nothing : *found->second;
    tally.add_image(image, plates, read);
    if (read.milliseconds >= 0) times.push_back(read.milliseconds);
  }
  PlateScores scores = std::move(tally.scores);
  scores.recall = share(scores.found, scores.boxes);
  scores.recall_at_03 = share(tally.found_at_03, scores.boxes);
  scores.precision = share(tally.matched, scores.returned);
  scores.exact_rate = share(scores.exact, scores.texts);
  scores.exact_any_rate = share(scores.exact_any, scores.texts);
  scores.top10_rate = share(scores.top10, scores.texts);
  scores.character_rate = share(tally.right_characters, tally.characters);
  scores.found_character_rate = share(tally.right_characters, tally.found_characters);
  scores.confidence_auc = area_under_curve(tally.right, tally.wrong);
  add_reliability(tally.right, tally.wrong, scores);
  add_times(std::move(times), scores);
  return scores;
}

nlohmann::ordered_json scores_json(const PlateScores& scores) {
  return {
      {"images", scores.images},
      {"truth", scores.truth},
      {"recall", rounded(scores.recall, 4)},
      {"recall_interval", interval_json(scores.found, scores.boxes)},
      {"recall03", rounded(scores.recall_at_03, 4)},
      {"prec", rounded(scores.precision, 4)},
      {"exact", rounded(scores.exact_rate, 4)},
      {"exact_interval", interval_json(scores.exact, scores.texts)},
      {"exact_o_as_0", rounded(share(scores.exact_o_as_0, scores.texts), 4)},
      {"exact_any", rounded(scores.exact_any_rate, 4)},
      {"top10", rounded(scores.top10_rate, 4)},
      {"char", rounded(scores.character_rate, 4)},
      {"char_found", rounded(scores.found_character_rate, 4)},
      {"conf_auc", rounded(scores.confidence_auc, 4)},
      {"calibration_error", rounded(scores.calibration_error, 4)},
      {"sure", scores.high_confidence},
      {"sure_wrong", scores.high_confidence_wrong},
      {"sure_wrong_interval", interval_json(scores.high_confidence_wrong, scores.high_confidence)},
      {"median_ms", rounded(scores.median_ms, 1)},
      {"p90_ms", rounded(scores.p90_ms, 1)},
      {"counts", fmt::format("found {}/{} exact {}/{} any {} top10 {} returned {}", scores.found,
                             scores.boxes, scores.exact, scores.texts, scores.exact_any,
                             scores.top10, scores.returned)}};
}

}  // namespace tarsier::plate
