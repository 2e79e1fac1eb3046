// SPDX-License-Identifier: MIT
#include "tarsier/plate/classic/character_reader.h"

#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/linalg/model_fields.h"
#include "tarsier/media/archive.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

namespace tarsier::plate {
namespace {

constexpr int kCharactersVersion = 1;
constexpr int kHogCell = 4;
constexpr int kHogBins = 9;
constexpr int kSvmRounds = 200;

std::vector<float> features_of(const cv::Mat& character, ReaderKind kind, int thumbnail_size) {
  return kind == ReaderKind::kMlp ? projection_features(character, thumbnail_size)
                                  : hog_features(character, kHogCell, kHogBins);
}

// Shifts by (dx, dy) px; uncovered pixels are dark.
cv::Mat shifted(const cv::Mat& character, int dx, int dy) {
  cv::Mat result(character.size(), CV_8UC1, cv::Scalar(0));
  const cv::Rect area(0, 0, character.cols, character.rows);
  const cv::Rect to = area & cv::Rect(dx, dy, character.cols, character.rows);
  character(to - cv::Point(dx, dy)).copyTo(result(to));
  return result;
}

// The character, and for the linear SVMs on gradients also imprecisely cropped versions of it:
// these SVMs do not learn that tolerance from a few hundred examples.
std::vector<cv::Mat> augmented(const cv::Mat& character, ReaderKind kind) {
  if (kind == ReaderKind::kMlp) return {character};
  return {character, shifted(character, 1, 0), shifted(character, -1, 0), shifted(character, 0, 1),
          shifted(character, 0, -1)};
}

}  // namespace

void CharacterReaderOptions::check() const {
  check_fields(*this);
  mlp.check();
}

std::vector<double> CharacterReader::probabilities(const cv::Mat& character) const {
  const std::vector<float> features = features_of(character, kind, thumbnail_size);
  std::vector<double> scores;
  if (kind == ReaderKind::kMlp) {
    for (const float value : mlp.run(features.data())) scores.push_back(static_cast<double>(value));
  } else {
    for (const LinearModel& svm : svms) scores.push_back(svm.margin(features.data()));
  }
  const double top = *std::max_element(scores.begin(), scores.end());
  double sum = 0;
  for (double& score : scores) sum += score = std::exp(sharpness * (score - top));
  for (double& score : scores) score /= sum;
  return scores;
}

CharacterReader train_character_reader(const CharacterSet& set, const std::vector<int>& indices,
                                       const CharacterReaderOptions& options, Rng rng,
                                       const std::stop_token& stop) {
  options.check();
  TARSIER_REQUIRE(!indices.empty(), "no characters to learn from");
  CharacterReader reader;
  reader.kind = options.kind;
  reader.symbols = set.symbols;
  reader.thumbnail_size = options.thumbnail_size;
  cv::Mat rows;
  std::vector<int> labels;
  for (const int i : indices) {
    const auto k = static_cast<std::size_t>(i);
    for (const cv::Mat& view : augmented(set.characters[k], options.kind)) {
      const std::vector<float> features = features_of(view, options.kind, options.thumbnail_size);
      rows.push_back(cv::Mat(features, true).reshape(1, 1));
      labels.push_back(set.labels[k]);
    }
  }
  const auto classes = static_cast<int>(set.symbols.size());
  if (options.kind == ReaderKind::kMlp) {
    reader.mlp = train_mlp(rows, labels, classes, options.mlp, rng, stop);
    return reader;
  }
  for (int c = 0; c < classes; ++c) {
    throw_if_stopped(stop);
    std::vector<int> binary_labels;
    binary_labels.reserve(labels.size());
    for (const int label : labels) binary_labels.push_back(label == c ? 1 : -1);
    reader.svms.push_back(train_linear_svm(rows, binary_labels, options.cost, kSvmRounds,
                                           rng.fork(static_cast<std::uint64_t>(c))));
  }
  return reader;
}

double character_error(const CharacterReader& reader, const CharacterSet& set,
                       const std::vector<int>& indices) {
  if (indices.empty()) return 0;
  int wrong = 0;
  for (const int i : indices) {
    const auto k = static_cast<std::size_t>(i);
    const std::vector<double> probabilities = reader.probabilities(set.characters[k]);
    const auto best =
        std::max_element(probabilities.begin(), probabilities.end()) - probabilities.begin();
    wrong += best != set.labels[k];
  }
  return static_cast<double>(wrong) / static_cast<double>(indices.size());
}

CharacterSplit split_characters(const CharacterSet& set, int train, Rng rng) {
  const auto count = static_cast<int>(set.characters.size());
  TARSIER_REQUIRE(train >= 1 && train < count, "{} of {} characters to learn from", train, count);
  std::vector<int> groups = set.groups;
  if (groups.empty()) {
    groups.resize(static_cast<std::size_t>(count));
    std::iota(groups.begin(), groups.end(), 0);
  }
  std::vector<int> order = groups;
  std::sort(order.begin(), order.end());
  order.erase(std::unique(order.begin(), order.end()), order.end());
  for (std::size_t i = order.size(); i > 1; --i)
    std::swap(order[i - 1],
              order[static_cast<std::size_t>(rng.integer(0, static_cast<int>(i) - 1))]);
  CharacterSplit split;
  for (const int group : order) {
    std::vector<int>& side =
        static_cast<int>(split.train.size()) < train ? split.train : split.test;
    for (int i = 0; i < count; ++i)
      if (groups[static_cast<std::size_t>(i)] == group) side.push_back(i);
  }
  return split;
}

cv::Mat normalized_character(const cv::Mat& crop) {
  TARSIER_REQUIRE(crop.type() == CV_8UC1 && !crop.empty(), "a character of type {}", crop.type());
  const int side = std::max(crop.cols, crop.rows);
  cv::Mat square(side, side, CV_8UC1, cv::Scalar(0));
  crop.copyTo(square({(side - crop.cols) / 2, (side - crop.rows) / 2, crop.cols, crop.rows}));
  cv::Mat result;
  cv::resize(square, result, {kCharacterSize, kCharacterSize}, 0, 0,
             side > 2 * kCharacterSize ? cv::INTER_AREA : cv::INTER_LINEAR);
  return result;
}

// --- files ---

namespace {

constexpr NameTable<ReaderKind, 2> kKinds{"reader",
                                          {{{ReaderKind::kMlp, "mlp"}, {ReaderKind::kHog, "hog"}}}};

void list_mlp(linalg::ModelFields& file, CharacterReader& reader, const cv::Mat& blank) {
  Mlp& net = reader.mlp;
  file.whole("low", reader.thumbnail_size, 1, kCharacterSize);
  if (file.reads()) {
    net.inputs = static_cast<int>(projection_features(blank, reader.thumbnail_size).size());
    net.outputs = static_cast<int>(reader.symbols.size());
  }
  file.whole("hidden", net.hidden, 1, 1000);
  file.list<float>("mean", net.mean, net.inputs);
  file.list<float>("scale", net.scale, net.inputs);
  file.require(std::all_of(net.scale.begin(), net.scale.end(), [](float s) { return s > 0; }),
               "scale: numbers above 0 are expected");
  file.rows("first", net.hidden_weights, net.hidden, net.inputs + 1);
  file.rows("second", net.output_weights, net.outputs, net.hidden + 1);
}

void list_svms(linalg::ModelFields& file, CharacterReader& reader, const cv::Mat& blank) {
  const std::size_t classes = reader.symbols.size();
  const std::size_t width = hog_features(blank, kHogCell, kHogBins).size();
  std::vector<float> weights;
  std::vector<float> bias;
  for (const LinearModel& svm : reader.svms) {
    weights.insert(weights.end(), svm.weights.begin(), svm.weights.end());
    bias.push_back(svm.bias);
  }
  file.rows("weights", weights, static_cast<std::int64_t>(classes),
            static_cast<std::int64_t>(width));
  file.list<float>("bias", bias, static_cast<std::int64_t>(classes));
  if (!file.reads()) return;
  reader.svms.resize(classes);
  for (std::size_t c = 0; c < classes; ++c) {
    const auto row = weights.begin() + static_cast<std::ptrdiff_t>(c * width);
    reader.svms[c].weights.assign(row, row + static_cast<std::ptrdiff_t>(width));
    reader.svms[c].bias = bias[c];
  }
}

void list_reader(linalg::ModelFields& file, CharacterReader& reader) {
  file.text("symbols", reader.symbols, 36);
  file.require(!reader.symbols.empty() &&
                   reader.symbols.find_first_not_of("0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ") ==
                       std::string::npos,
               "symbols: digits and capital letters are expected");
  file.number("sharpness", reader.sharpness, 0.01, 100);
  file.named("kind", reader.kind, kKinds);
  const cv::Mat blank(kCharacterSize, kCharacterSize, CV_8UC1, cv::Scalar(0));
  if (reader.kind == ReaderKind::kMlp)
    list_mlp(file, reader, blank);
  else
    list_svms(file, reader, blank);
}

}  // namespace

void write_character_reader(const std::string& path, const CharacterReader& reader,
                            const nlohmann::json& provenance) {
  write_archive(path, {"plate-characters", kCharactersVersion, provenance,
                       linalg::written(reader, list_reader)});
}

CharacterReader read_character_reader(const std::string& path) {
  return linalg::read_fields<CharacterReader>(
      read_archive(path, "plate-characters", kCharactersVersion).payload, path, list_reader);
}

}  // namespace tarsier::plate
