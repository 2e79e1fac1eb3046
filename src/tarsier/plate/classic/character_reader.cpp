// SPDX-License-Identifier: MIT
#include "tarsier/plate/classic/character_reader.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/archive.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tarsier::plate {
namespace {

constexpr int kVersion = 1;
constexpr int kHogCell = 4;
constexpr int kHogBins = 9;
constexpr int kSvmRounds = 200;

std::vector<float> features_of(const cv::Mat& character, ReaderKind kind, int low) {
  return kind == ReaderKind::kMlp ? projection_features(character, low)
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
// these machines do not learn that tolerance from a few hundred examples.
std::vector<cv::Mat> views_of(const cv::Mat& character, ReaderKind kind) {
  if (kind == ReaderKind::kMlp) return {character};
  return {character, shifted(character, 1, 0), shifted(character, -1, 0), shifted(character, 0, 1),
          shifted(character, 0, -1)};
}

}  // namespace

void CharacterReaderOptions::check() const {
  check_fields(*this);
  mlp.check();
}

std::vector<double> CharacterReader::chances(const cv::Mat& character) const {
  const std::vector<float> features = features_of(character, kind, low);
  std::vector<double> scores;
  if (kind == ReaderKind::kMlp) {
    for (const float value : mlp.run(features.data())) scores.push_back(static_cast<double>(value));
  } else {
    for (const LinearModel& machine : machines) scores.push_back(machine.margin(features.data()));
  }
  const double top = *std::max_element(scores.begin(), scores.end());
  double sum = 0;
  for (double& score : scores) sum += score = std::exp(sharpness * (score - top));
  for (double& score : scores) score /= sum;
  return scores;
}

CharacterReader train_character_reader(const CharacterSet& set, const std::vector<int>& chosen,
                                       const CharacterReaderOptions& options, Rng rng,
                                       const std::stop_token& stop) {
  options.check();
  TARSIER_REQUIRE(!chosen.empty(), "no characters to learn from");
  CharacterReader reader;
  reader.kind = options.kind;
  reader.symbols = set.symbols;
  reader.low = options.low;
  cv::Mat rows;
  std::vector<int> labels;
  for (const int i : chosen) {
    const auto k = static_cast<std::size_t>(i);
    for (const cv::Mat& view : views_of(set.characters[k], options.kind)) {
      std::vector<float> features = features_of(view, options.kind, options.low);
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
    std::vector<int> sides;
    for (const int label : labels) sides.push_back(label == c ? 1 : -1);
    reader.machines.push_back(train_linear_svm(rows, sides, options.cost, kSvmRounds,
                                               rng.fork(static_cast<std::uint64_t>(c))));
  }
  return reader;
}

double character_error(const CharacterReader& reader, const CharacterSet& set,
                       const std::vector<int>& chosen) {
  if (chosen.empty()) return 0;
  int wrong = 0;
  for (const int i : chosen) {
    const auto k = static_cast<std::size_t>(i);
    const std::vector<double> chances = reader.chances(set.characters[k]);
    const auto best = std::max_element(chances.begin(), chances.end()) - chances.begin();
    wrong += best != set.labels[k];
  }
  return static_cast<double>(wrong) / static_cast<double>(chosen.size());
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

cv::Mat normalized_character(const cv::Mat& cut) {
  TARSIER_REQUIRE(cut.type() == CV_8UC1 && !cut.empty(), "a character of type {}", cut.type());
  const int side = std::max(cut.cols, cut.rows);
  cv::Mat square(side, side, CV_8UC1, cv::Scalar(0));
  cut.copyTo(square({(side - cut.cols) / 2, (side - cut.rows) / 2, cut.cols, cut.rows}));
  cv::Mat result;
  cv::resize(square, result, {kCharacterSize, kCharacterSize}, 0, 0,
             side > 2 * kCharacterSize ? cv::INTER_AREA : cv::INTER_LINEAR);
  return result;
}

// --- files ---

void write_character_reader(const std::string& path, const CharacterReader& reader,
                            const nlohmann::json& provenance) {
  Archive archive;
  archive.type = "plate-characters";
  archive.version = kVersion;
  archive.provenance = provenance;
  archive.payload["symbols"] = reader.symbols;
  archive.payload["sharpness"] = reader.sharpness;
  if (reader.kind == ReaderKind::kMlp) {
    const Mlp& net = reader.mlp;
    archive.payload["kind"] = "mlp";
    archive.payload["low"] = reader.low;
    archive.payload["hidden"] = net.hidden;
    archive.payload["mean"] = pack(PackedArray<float>{{net.inputs}, net.mean});
    archive.payload["scale"] = pack(PackedArray<float>{{net.inputs}, net.scale});
    archive.payload["first"] = pack(PackedArray<float>{{net.hidden, net.inputs + 1}, net.first});
    archive.payload["second"] = pack(PackedArray<float>{{net.outputs, net.hidden + 1}, net.second});
  } else {
    archive.payload["kind"] = "hog";
    std::vector<float> weights;
    std::vector<float> bias;
    for (const LinearModel& machine : reader.machines) {
      weights.insert(weights.end(), machine.weights.begin(), machine.weights.end());
      bias.push_back(machine.bias);
    }
    const auto classes = static_cast<std::int64_t>(reader.machines.size());
    archive.payload["weights"] = pack(PackedArray<float>{
        {classes, static_cast<std::int64_t>(weights.size()) / classes}, weights});
    archive.payload["bias"] = pack(PackedArray<float>{{classes}, bias});
  }
  write_archive(path, archive);
}

CharacterReader read_character_reader(const std::string& path) {
  const Archive archive = read_archive(path, "plate-characters", kVersion);
  const nlohmann::json& payload = archive.payload;
  CharacterReader reader;
  reader.symbols = text_member(payload, "symbols", path, 36);
  if (reader.symbols.empty() ||
      reader.symbols.find_first_not_of("0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ") != std::string::npos)
    throw ModelError(path, "symbols: digits and capital letters are expected");
  reader.sharpness = number_member(payload, "sharpness", path, 0.01, 100);
  const auto classes = static_cast<std::int64_t>(reader.symbols.size());
  const cv::Mat blank(kCharacterSize, kCharacterSize, CV_8UC1, cv::Scalar(0));
  const auto numbers = [&](const char* name, std::initializer_list<std::int64_t> shape) {
    return unpack<float>(member(payload, name, path), path, name, shape).values;
  };
  const std::string kind = text_member(payload, "kind", path);
  if (kind == "mlp") {
    reader.kind = ReaderKind::kMlp;
    reader.low = static_cast<int>(integer_member(payload, "low", path, 1, kCharacterSize));
    Mlp& net = reader.mlp;
    net.inputs = static_cast<int>(projection_features(blank, reader.low).size());
    net.hidden = static_cast<int>(integer_member(payload, "hidden", path, 1, 1000));
    net.outputs = static_cast<int>(classes);
    net.mean = numbers("mean", {net.inputs});
    net.scale = numbers("scale", {net.inputs});
    net.first = numbers("first", {net.hidden, net.inputs + 1});
    net.second = numbers("second", {net.outputs, net.hidden + 1});
    if (std::any_of(net.scale.begin(), net.scale.end(), [](float s) { return !(s > 0); }))
      throw ModelError(path, "scale: numbers above 0 are expected");
    return reader;
  }
  if (kind != "hog") throw ModelError(path, "kind: mlp or hog is expected");
  const auto width = static_cast<std::int64_t>(hog_features(blank, kHogCell, kHogBins).size());
  const std::vector<float> weights = numbers("weights", {classes, width});
  const std::vector<float> bias = numbers("bias", {classes});
  for (std::int64_t c = 0; c < classes; ++c) {
    LinearModel machine;
    machine.weights.assign(weights.begin() + c * width, weights.begin() + (c + 1) * width);
    machine.bias = bias[static_cast<std::size_t>(c)];
    reader.machines.push_back(std::move(machine));
  }
  return reader;
}

}  // namespace tarsier::plate
