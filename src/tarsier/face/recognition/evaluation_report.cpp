// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/evaluation.h"
#include "tarsier/image/draw/plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>

namespace tarsier::face::recognition {
namespace {

std::string rate(double value) { return value < 0 ? std::string() : fmt::format("{:.4f}", value); }

// Training images of each person; in gallery mode, all gallery images.
int training_of(const EvaluationResult& result) {
  return result.options.gallery > 0 ? result.options.gallery : result.options.training;
}

std::string csv_row(const EvaluationResult& result, const SeedResult& seed,
                    const std::string& name) {
  return fmt::format(
      "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{:.3f},{:.3f}\n",
      name_of(result.algorithm), training_of(result), name, seed.people, seed.probes,
      seed.identified.hits, rate(seed.accuracy), seed.known_probes, seed.unknown_probes,
      rate(seed.true_accept_rate), rate(seed.correct_accept_rate), rate(seed.equal_error_rate),
      rate(seed.auc), seed.calibrated_true_accept_count.hits,
      rate(seed.calibrated_true_accept_rate), seed.calibrated_correct_accept_count.hits,
      rate(seed.calibrated_correct_accept_rate), seed.calibrated_false_accept_count.hits,
      rate(seed.calibrated_false_accept_rate), seed.train_seconds, seed.identify_ms);
}

image::draw::Plot cmc_data(const std::vector<EvaluationResult>& results) {
  image::draw::Plot plot;
  plot.title = "Cumulative match";
  plot.x.label = "rank";
  plot.y.label = "share of the probes";
  plot.y.high = 1.0;
  plot.legend = image::draw::LegendPosition::kBottomRight;
  for (const auto& result : results) {
    const Curve curve = cmc_curve(result);
    image::draw::Series series;
    series.name = fmt::format("{}, {} images", name_of(result.algorithm), training_of(result));
    series.x = curve.x;
    series.y = curve.y;
    series.markers = true;
    plot.series.push_back(std::move(series));
  }
  return plot;
}

image::draw::Plot roc_data(const std::vector<EvaluationResult>& results) {
  image::draw::Plot plot;
  plot.title = "Half of the people enrolled";
  plot.x.label = "strangers accepted";
  plot.x.logarithmic = true;
  plot.x.low = 0.001;
  plot.x.high = 1.0;
  plot.y.label = "known people accepted";
  plot.y.low = 0.0;
  plot.y.high = 1.0;
  plot.legend = image::draw::LegendPosition::kBottomRight;
  for (const auto& result : results) {
    const Curve curve = roc_curve(result);
    image::draw::Series series;
    series.name = fmt::format("{}, {} images", name_of(result.algorithm), training_of(result));
    series.x = curve.x;
    series.y = curve.y;
    plot.series.push_back(std::move(series));
  }
  return plot;
}

}  // namespace

SeedResult EvaluationResult::mean() const {
  SeedResult out;
  if (seeds.empty()) return out;
  const auto average = [&](auto SeedResult::*field) {
    double sum = 0;
    double count = 0;
    for (const auto& seed : seeds) {
      const auto value = static_cast<double>(seed.*field);
      if (value < 0) continue;
      sum += value;
      count += 1;
    }
    return count > 0 ? sum / count : -1;
  };
  out.people = seeds.front().people;
  out.training = seeds.front().training;
  out.accuracy = average(&SeedResult::accuracy);
  out.true_accept_rate = average(&SeedResult::true_accept_rate);
  out.correct_accept_rate = average(&SeedResult::correct_accept_rate);
  out.equal_error_rate = average(&SeedResult::equal_error_rate);
  out.auc = average(&SeedResult::auc);
  out.calibrated_true_accept_rate = average(&SeedResult::calibrated_true_accept_rate);
  out.calibrated_correct_accept_rate = average(&SeedResult::calibrated_correct_accept_rate);
  out.calibrated_false_accept_rate = average(&SeedResult::calibrated_false_accept_rate);
  out.train_seconds = average(&SeedResult::train_seconds);
  out.identify_ms = average(&SeedResult::identify_ms);
  out.probes = 0;
  for (const auto& seed : seeds) {
    out.probes += seed.probes;
    out.known_probes += seed.known_probes;
    out.unknown_probes += seed.unknown_probes;
    out.calibrated = out.calibrated || seed.calibrated;
  }
  for (const auto count :
       {&SeedResult::identified, &SeedResult::true_accept_count, &SeedResult::correct_accept_count,
        &SeedResult::calibrated_true_accept_count, &SeedResult::calibrated_correct_accept_count,
        &SeedResult::calibrated_false_accept_count})
    out.*count = rate(count).count;
  return out;
}

Rate EvaluationResult::rate(Count SeedResult::*count) const {
  Rate out;
  for (const auto& seed : seeds) {
    const Count& one = seed.*count;
    if (one.trials == 0) continue;
    out.count.hits += one.hits;
    out.count.trials += one.trials;
    ++out.draws;
  }
  if (out.draws == 0) return out;
  const auto trials = static_cast<double>(out.count.trials);
  out.value = static_cast<double>(out.count.hits) / trials;
  out.interval = wilson_interval_of_rate(out.value, trials / out.draws);
  return out;
}

Curve cmc_curve(const EvaluationResult& result) {
  int people = 0;
  double probes = 0;
  for (const auto& seed : result.seeds) {
    people = std::max(people, seed.people);
    probes += static_cast<double>(seed.closed_set.size());
  }
  std::vector<double> at(static_cast<std::size_t>(people) + 1, 0.0);
  for (const auto& seed : result.seeds)
    for (const auto& probe : seed.closed_set)
      if (probe.rank > 0) at[static_cast<std::size_t>(probe.rank)] += 1;
  Curve curve;
  double sum = 0;
  for (int rank = 1; rank <= people; ++rank) {
    sum += at[static_cast<std::size_t>(rank)];
    curve.x.push_back(rank);
    curve.y.push_back(probes > 0 ? sum / probes : 0);
  }
  return curve;
}

Curve roc_curve(const EvaluationResult& result) {
  std::vector<double> known;
  std::vector<double> unknown;
  for (const auto& seed : result.seeds)
    for (const auto& probe : seed.open_set) (probe.known ? known : unknown).push_back(probe.score);
  Curve curve;
  if (known.empty() || unknown.empty()) return curve;
  std::sort(known.begin(), known.end(), std::greater<>());
  std::sort(unknown.begin(), unknown.end(), std::greater<>());
  std::size_t k = 0;
  std::size_t s = 0;
  while (k < known.size() || s < unknown.size()) {
    const double next = std::max(k < known.size() ? known[k] : unknown[s],
                                 s < unknown.size() ? unknown[s] : known[k]);
    while (k < known.size() && known[k] >= next) ++k;
    while (s < unknown.size() && unknown[s] >= next) ++s;
    curve.x.push_back(static_cast<double>(s) / static_cast<double>(unknown.size()));
    curve.y.push_back(static_cast<double>(k) / static_cast<double>(known.size()));
  }
  return curve;
}

std::string evaluation_csv(const std::vector<EvaluationResult>& results) {
  std::string out =
      "algorithm,training,seed,people,probes,identified,accuracy,known_probes,stranger_probes,"
      "true_accepts,right_accepts,equal_error,auc,stated_true,stated_true_accepts,stated_right,"
      "stated_right_accepts,stated_false,stated_false_accepts,train_seconds,identify_ms\n";
  for (const auto& result : results) {
    for (const auto& seed : result.seeds) out += csv_row(result, seed, std::to_string(seed.seed));
    out += csv_row(result, result.mean(), "all");
  }
  return out;
}

cv::Mat cmc_plot(const std::vector<EvaluationResult>& results, cv::Size size) {
  return image::draw::plot_image(cmc_data(results), size);
}

cv::Mat roc_plot(const std::vector<EvaluationResult>& results, cv::Size size) {
  return image::draw::plot_image(roc_data(results), size);
}

std::string cmc_plot_svg(const std::vector<EvaluationResult>& results, cv::Size size) {
  return image::draw::plot_svg(cmc_data(results), size);
}

std::string roc_plot_svg(const std::vector<EvaluationResult>& results, cv::Size size) {
  return image::draw::plot_svg(roc_data(results), size);
}

}  // namespace tarsier::face::recognition
