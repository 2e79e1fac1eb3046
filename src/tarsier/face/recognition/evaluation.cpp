// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/evaluation.h"

#include "tarsier/core/elapsed.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/recognition/background_space.h"
#include "tarsier/face/recognition/deep.h"
#include "tarsier/media/image_file.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <numeric>
#include <random>
#include <set>
#include <sstream>
#include <string_view>
#include <utility>

namespace tarsier::face::recognition {
namespace {

constexpr std::int64_t kMaxListBytes = 1'000'000'000;
// px; crop_face() needs these.
constexpr double kMaxEyePosition = 1e6;
constexpr double kMinEyeDistance = 1;

// 0..n-1 in random order. The draws are those of numpy.random.RandomState(seed).permutation(n), so
// that a split can be reproduced outside.
std::vector<int> permutation(int n, std::mt19937& generator) {
  std::vector<int> values(static_cast<std::size_t>(n));
  std::iota(values.begin(), values.end(), 0);
  for (int i = n - 1; i > 0; --i) {
    const auto most = static_cast<std::uint32_t>(i);
    const std::uint32_t mask = std::bit_ceil(most + 1) - 1;
    std::uint32_t draw = 0;
    do draw = static_cast<std::uint32_t>(generator()) & mask;
    while (draw > most);
    std::swap(values[static_cast<std::size_t>(i)], values[draw]);
  }
  return values;
}

// For each person, whether he or she is enrolled: `enrolled` of `people` at random, 0: all.
std::vector<bool> choose_people(std::size_t people, std::uint64_t seed, int enrolled) {
  std::vector<bool> out(people, true);
  const auto enrolled_count = static_cast<std::size_t>(std::max(0, enrolled));
  if (enrolled_count == 0 || enrolled_count >= people) return out;
  std::mt19937 generator(static_cast<std::uint32_t>(seed + 1000));
  const auto order = permutation(static_cast<int>(people), generator);
  for (std::size_t i = enrolled_count; i < order.size(); ++i)
    out[static_cast<std::size_t>(order[i])] = false;
  return out;
}

struct Run {
  std::vector<ProbeResult> results;
  Recognizer model;
  double train_seconds = 0;
  double identify_ms = 0;
};

// `coordinates`: of all faces, in the directions of the background; if empty, they are computed
// from the faces.
Run run(const std::vector<cv::Mat>& faces, const Rows& coordinates,
        const std::vector<std::string>& labels, const Split& split,
        const RecognizerOptions& options, const Background* background,
        const std::stop_token& stop) {
  std::vector<cv::Mat> training;
  std::vector<std::string> names;
  Rows training_rows(static_cast<Eigen::Index>(split.training.size()), coordinates.cols());
  for (const int i : split.training) {
    if (coordinates.size() > 0)
      training_rows.row(static_cast<Eigen::Index>(names.size())) = coordinates.row(i);
    else
      training.push_back(faces[static_cast<std::size_t>(i)]);
    names.push_back(labels[static_cast<std::size_t>(i)]);
  }
  Run out;
  NoProgress quiet;
  auto start = std::chrono::steady_clock::now();
  out.model = coordinates.size() > 0
                  ? train_coordinates(training_rows, names, options, quiet, stop, *background)
                  : train(training, names, options, quiet, stop, background);
  out.train_seconds = seconds_since(start);
  start = std::chrono::steady_clock::now();
  for (const int i : split.probes) {
    throw_if_stopped(stop);
    std::vector<float> probe;
    if (coordinates.size() > 0) {
      const Rows row = templates_of_coordinates(out.model, *background, coordinates.row(i));
      probe.assign(row.data(), row.data() + row.size());
    } else {
      probe = template_of(out.model, faces[static_cast<std::size_t>(i)]);
    }
    const auto people = identify_template(out.model, probe);
    ProbeResult result;
    result.face = i;
    result.score = people.front().score;
    for (std::size_t r = 0; r < people.size(); ++r) {
      if (out.model.labels[static_cast<std::size_t>(people[r].person)] !=
          labels[static_cast<std::size_t>(i)])
        continue;
      result.known = true;
      result.rank = static_cast<int>(r) + 1;
    }
    result.correct = result.rank == 1;
    out.results.push_back(result);
  }
  if (!split.probes.empty())
    out.identify_ms = 1000 * seconds_since(start) / static_cast<double>(split.probes.size());
  return out;
}

std::pair<std::vector<double>, std::vector<double>> genuine_and_impostor_scores(
    const std::vector<ProbeResult>& results) {
  std::pair<std::vector<double>, std::vector<double>> out;
  for (const auto& result : results)
    (result.known ? out.first : out.second).push_back(result.score);
  return out;
}

double share_from(const std::vector<double>& sorted, double threshold) {
  const auto below = std::lower_bound(sorted.begin(), sorted.end(), threshold) - sorted.begin();
  return 1 - static_cast<double>(below) / static_cast<double>(sorted.size());
}

Count count_of(const std::vector<ProbeResult>& results, auto&& of, auto&& that) {
  Count count;
  for (const auto& result : results) {
    if (!of(result)) continue;
    ++count.trials;
    if (that(result)) ++count.hits;
  }
  return count;
}

double share(const Count& count) {
  return count.trials > 0 ? static_cast<double>(count.hits) / static_cast<double>(count.trials)
                          : -1;
}

}  // namespace

std::vector<LabelledFace> read_face_list(const std::string& path) {
  std::istringstream stream(read_file(path, kMaxListBytes));
  const auto folder = std::filesystem::path(path).parent_path();
  std::vector<LabelledFace> out;
  std::string line;
  for (int number = 1; std::getline(stream, line); ++number) {
    const auto wrong = [&](const std::string& reason) {
      return InputError(path, "line " + std::to_string(number) + ": " + reason);
    };
    if (line.size() > 1'000'000) throw wrong("longer than a million characters");
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (line.empty() || line.front() == '#') continue;
    std::vector<std::string> fields(1);
    for (const char c : line) {
      if (c == '\t')
        fields.emplace_back();
      else
        fields.back().push_back(c);
    }
    if ((fields.size() != 2 && fields.size() != 6) || fields[0].empty() || fields[1].empty())
      throw wrong("not 'path<TAB>label', nor with four numbers for the eyes");
    LabelledFace face{fields[0], fields[1]};
    const std::filesystem::path own(face.path);
    std::error_code ignored;
    if (own.is_relative() && !std::filesystem::exists(own, ignored) &&
        std::filesystem::exists(folder / own, ignored))
      face.path = (folder / own).string();
    if (fields.size() == 6) {
      double eyes[4];
      for (std::size_t i = 0; i < 4; ++i) {
        const std::string& text = fields[i + 2];
        const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), eyes[i]);
        if (error != std::errc{} || end != text.data() + text.size() || !std::isfinite(eyes[i]))
          throw wrong("'" + text + "' is not a number");
        if (std::abs(eyes[i]) >= kMaxEyePosition) throw wrong("an eye at " + text + " px");
      }
      if (std::hypot(eyes[2] - eyes[0], eyes[3] - eyes[1]) < kMinEyeDistance)
        throw wrong("eyes less than 1 px apart");
      face.left_eye = {eyes[0], eyes[1]};
      face.right_eye = {eyes[2], eyes[3]};
    }
    out.push_back(std::move(face));
    if (out.size() > 10'000'000) throw wrong("more than ten million faces");
  }
  if (out.empty()) throw InputError(path, "no faces");
  return out;
}

void EvaluationOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(!seeds.empty() && seeds.size() <= 1000, "{} seeds", seeds.size());
}

int count_people(const std::vector<std::string>& labels) {
  return static_cast<int>(std::set<std::string_view>(labels.begin(), labels.end()).size());
}

Split split_of(const std::vector<std::string>& labels, int training, std::uint64_t seed,
               int enrolled_people, const std::vector<bool>& may_train) {
  Split split;
  std::map<std::string, std::vector<int>> images;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    std::vector<int>& list = images[labels[i]];
    const bool may = may_train.empty() || may_train[i];
    (may ? list : split.probes).push_back(static_cast<int>(i));
  }
  const std::vector<bool> enrolled = choose_people(images.size(), seed, enrolled_people);
  std::mt19937 generator(static_cast<std::uint32_t>(seed));
  std::size_t person = 0;
  for (const auto& [label, list] : images) {
    const auto order = permutation(static_cast<int>(list.size()), generator);
    for (std::size_t i = 0; i < list.size(); ++i) {
      const bool trains = enrolled[person] && i < static_cast<std::size_t>(training);
      const int image = list[static_cast<std::size_t>(order[i])];
      (trains ? split.training : split.probes).push_back(image);
    }
    ++person;
  }
  std::sort(split.training.begin(), split.training.end());
  std::sort(split.probes.begin(), split.probes.end());
  return split;
}

Split split_of_gallery(const std::vector<std::string>& labels, int gallery, std::uint64_t seed,
                       int enrolled_people) {
  const std::set<std::string_view> people(labels.begin(), labels.end());
  const std::vector<bool> enrolled = choose_people(people.size(), seed, enrolled_people);
  std::map<std::string_view, bool> trains;
  for (const std::string_view label : people) trains.emplace(label, enrolled[trains.size()]);
  Split split;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    if (i >= static_cast<std::size_t>(std::max(0, gallery)))
      split.probes.push_back(static_cast<int>(i));
    else if (trains.at(labels[i]))
      split.training.push_back(static_cast<int>(i));
  }
  return split;
}

AcceptRates accept_rates(std::vector<double> genuine, std::vector<double> impostor, double rate) {
  TARSIER_REQUIRE(!genuine.empty() && !impostor.empty(), "{} known, {} strangers", genuine.size(),
                  impostor.size());
  std::sort(genuine.begin(), genuine.end());
  std::sort(impostor.begin(), impostor.end());
  std::vector<double> thresholds = genuine;
  thresholds.insert(thresholds.end(), impostor.begin(), impostor.end());
  thresholds.push_back(std::numeric_limits<double>::infinity());
  std::sort(thresholds.begin(), thresholds.end());
  thresholds.erase(std::unique(thresholds.begin(), thresholds.end()), thresholds.end());
  AcceptRates out;
  bool found = false;
  double closest = 2;
  for (const double threshold : thresholds) {
    const double tar = share_from(genuine, threshold);
    const double far = share_from(impostor, threshold);
    if (!found && far <= rate) {
      found = true;
      out.threshold = threshold;
      out.true_accept_rate = tar;
    }
    if (std::abs(1 - tar - far) < closest) {
      closest = std::abs(1 - tar - far);
      out.equal_error_rate = (1 - tar + far) / 2;
    }
  }
  for (const double score : genuine) {
    const auto below = std::lower_bound(impostor.begin(), impostor.end(), score);
    const auto to = std::upper_bound(impostor.begin(), impostor.end(), score);
    out.auc += (static_cast<double>(below - impostor.begin()) +
                static_cast<double>(to - impostor.begin())) /
               2 / static_cast<double>(impostor.size()) / static_cast<double>(genuine.size());
  }
  return out;
}

EvaluationResult evaluate(const std::vector<cv::Mat>& faces, const std::vector<std::string>& labels,
                          const RecognizerOptions& recognizer, const EvaluationOptions& options,
                          Progress& progress, const std::stop_token& stop,
                          const Background* background) {
  options.check();
  TARSIER_REQUIRE(options.may_train.empty() || options.may_train.size() == faces.size(),
                  "{} faces, {} of which it is known whether they may train", faces.size(),
                  options.may_train.size());
  TARSIER_REQUIRE(faces.size() == labels.size(), "{} faces, {} labels", faces.size(),
                  labels.size());
  const int people = count_people(labels);
  if (options.open_set) {
    if (people < 2) throw std::invalid_argument("strangers need at least two people in the list");
    if (options.enrolled >= people)
      throw std::invalid_argument(std::to_string(options.enrolled) + " enrolled of " +
                                  std::to_string(people) + " people leave no strangers");
  }
  EvaluationResult out;
  out.algorithm = recognizer.algorithm;
  out.options = options;
  out.with_background = background != nullptr && is_whitened(recognizer.algorithm);
  // The templates of a network do not depend on who is enrolled. They are computed once.
  Rows coordinates;
  double describe_ms = 0;
  if (recognizer.algorithm == Algorithm::kDeep) {
    if (background == nullptr || !background->network)
      throw std::invalid_argument("deep templates need their network and its background");
    const auto start = std::chrono::steady_clock::now();
    coordinates.resize(static_cast<Eigen::Index>(faces.size()), coordinate_count(*background));
    progress.begin("describing", static_cast<std::int64_t>(faces.size()), "faces");
    for (std::size_t i = 0; i < faces.size(); ++i) {
      throw_if_stopped(stop);
      const std::vector<float> row = coordinates_of(*background, faces[i]);
      coordinates.row(static_cast<Eigen::Index>(i)) =
          Eigen::Map<const Eigen::RowVectorXf>(row.data(), coordinates.cols());
      progress.advance();
    }
    progress.end();
    describe_ms = 1000 * seconds_since(start) / static_cast<double>(faces.size());
  }
  progress.begin("evaluating " + std::string(name_of(recognizer.algorithm)),
                 static_cast<std::int64_t>(options.seeds.size()), "splits");
  const auto any = [](const ProbeResult&) { return true; };
  const auto known = [](const ProbeResult& r) { return r.known; };
  const auto unknown = [](const ProbeResult& r) { return !r.known; };
  const auto is_correct = [](const ProbeResult& r) { return r.correct; };
  const auto may_train = [&](int face) {
    return options.may_train.empty() || options.may_train[static_cast<std::size_t>(face)];
  };
  // Removes the probes that may not train and returns them.
  const auto take_uncertain = [&](std::vector<ProbeResult>& results) {
    const auto first = std::stable_partition(
        results.begin(), results.end(), [&](const ProbeResult& r) { return may_train(r.face); });
    std::vector<ProbeResult> uncertain(first, results.end());
    results.erase(first, results.end());
    return uncertain;
  };
  const auto split = [&](std::uint64_t seed, int enrolled) {
    return options.gallery > 0
               ? split_of_gallery(labels, options.gallery, seed, enrolled)
               : split_of(labels, options.training, seed, enrolled, options.may_train);
  };
  for (const auto seed : options.seeds) {
    const Split closed = split(seed, 0);
    const bool any_probe = std::any_of(closed.probes.begin(), closed.probes.end(), may_train);
    if (!any_probe && options.gallery > 0)
      throw std::invalid_argument("all " + std::to_string(labels.size()) +
                                  " faces are training images, and no probe is left");
    if (!any_probe)
      throw std::invalid_argument("no person has more than the training images (" +
                                  std::to_string(options.training) + ")");
    SeedResult result;
    result.seed = seed;
    Run first = run(faces, coordinates, labels, closed, recognizer, background, stop);
    result.people = static_cast<int>(first.model.labels.size());
    result.training = static_cast<int>(closed.training.size());
    result.train_seconds = first.train_seconds;
    result.identify_ms = first.identify_ms + describe_ms;
    const std::vector<ProbeResult> uncertain = take_uncertain(first.results);
    result.closed_set = std::move(first.results);
    result.probes = static_cast<int>(result.closed_set.size());
    result.uncertain_identified = count_of(uncertain, any, is_correct);
    result.identified = count_of(result.closed_set, any, is_correct);
    result.accuracy = share(result.identified);
    if (options.open_set) {
      const int enrolled = options.enrolled > 0 ? options.enrolled : people / 2;
      Run second =
          run(faces, coordinates, labels, split(seed, enrolled), recognizer, background, stop);
      const std::vector<ProbeResult> uncertain_open = take_uncertain(second.results);
      result.open_set = std::move(second.results);
      auto [genuine, impostor] = genuine_and_impostor_scores(result.open_set);
      result.known_probes = static_cast<int>(genuine.size());
      result.unknown_probes = static_cast<int>(impostor.size());
      if (!genuine.empty() && !impostor.empty()) {
        const auto rates = accept_rates(genuine, impostor, options.false_accepts);
        const auto above = [&](const ProbeResult& r) { return r.score >= rates.threshold; };
        result.true_accept_rate = rates.true_accept_rate;
        result.equal_error_rate = rates.equal_error_rate;
        result.auc = rates.auc;
        result.true_accept_count = count_of(result.open_set, known, above);
        result.correct_accept_count = count_of(
            result.open_set, known, [&](const ProbeResult& r) { return r.correct && above(r); });
        result.correct_accept_rate = share(result.correct_accept_count);
      }
      result.calibrated = second.model.calibration.has_value();
      if (result.calibrated) {
        const double threshold = second.model.calibration->threshold(
            options.stated_rate, static_cast<int>(second.model.labels.size()));
        const auto above = [&](const ProbeResult& r) { return r.score >= threshold; };
        result.calibrated_true_accept_count = count_of(result.open_set, known, above);
        result.calibrated_correct_accept_count = count_of(
            result.open_set, known, [&](const ProbeResult& r) { return r.correct && above(r); });
        result.calibrated_false_accept_count = count_of(result.open_set, unknown, above);
        result.uncertain_true_accept_count = count_of(uncertain_open, known, above);
        result.uncertain_false_accept_count = count_of(uncertain_open, unknown, above);
        result.calibrated_true_accept_rate = share(result.calibrated_true_accept_count);
        result.calibrated_correct_accept_rate = share(result.calibrated_correct_accept_count);
        result.calibrated_false_accept_rate = share(result.calibrated_false_accept_count);
      }
    }
    out.seeds.push_back(std::move(result));
    progress.advance();
  }
  progress.end();
  return out;
}

}  // namespace tarsier::face::recognition
