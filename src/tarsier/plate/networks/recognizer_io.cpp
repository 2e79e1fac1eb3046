// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/media/archive.h"
#include "tarsier/plate/networks/recognizer.h"

#include <nlohmann/json.hpp>

namespace tarsier::plate {
namespace {

constexpr int kVersion = 1;

// A network whose first layer takes one plane and whose last gives `out` numbers a place.
linalg::Network read_network(const nlohmann::json& payload, const char* name, linalg::Shape input,
                             linalg::Shape output, const std::string& path) {
  linalg::Network network = linalg::network_from_json(member(payload, name, path), path);
  linalg::Shape found;
  try {
    found = network.output(input);
  } catch (const std::exception& error) {
    throw ModelError(path, std::string(name) + ": " + error.what());
  }
  if (found != output || network.cost(input) > 2e9)
    throw ModelError(path, std::string(name) + ": is no network for this");
  return network;
}

// Models of before lack some: those numbers stay as they are.
template <std::size_t N>
void read_numbers(const nlohmann::json& payload, const char* name, const std::string& path,
                  std::array<double, N>& numbers) {
  if (!payload.contains(name)) return;
  const PackedArray<double> given = unpack<double>(payload[name], path, name, {N});
  std::copy(given.values.begin(), given.values.end(), numbers.begin());
}

template <std::size_t N>
nlohmann::json packed(const std::array<double, N>& numbers) {
  return pack(PackedArray<double>{{N}, {numbers.begin(), numbers.end()}});
}

}  // namespace

DetectorModel read_detector_model(const std::string& path) {
  const Archive archive = read_archive(path, "plate-detector", kVersion);
  DetectorModel model;
  model.detector =
      read_network(archive.payload, "detector", {1, 10 * kCell, 20 * kCell}, {9, 10, 20}, path);
  model.aligner =
      read_network(archive.payload, "aligner", {1, kAlignHeight, kAlignWidth}, {18, 1, 1}, path);
  return model;
}

void write_detector_model(const std::string& path, const DetectorModel& model,
                          const nlohmann::json& provenance) {
  Archive archive;
  archive.type = "plate-detector";
  archive.version = kVersion;
  archive.provenance = provenance;
  archive.payload = {{"detector", linalg::network_to_json(model.detector)},
                     {"aligner", linalg::network_to_json(model.aligner)}};
  write_archive(path, archive);
}

ReaderModel read_reader_model(const std::string& path) {
  const Archive archive = read_archive(path, "plate-reader", kVersion);
  ReaderModel model;
  model.line = read_network(archive.payload, "line", {1, kLineHeight, kLineWidth},
                            {kClasses, 1, kLineWidth / kColumn}, path);
  const PackedArray<double> weights =
      unpack<double>(member(archive.payload, "calibration", path), path, "calibration", {5});
  std::copy(weights.values.begin(), weights.values.end(), model.calibration.weights.begin());
  if (archive.payload.contains("calibration_logits")) {
    const PackedArray<double> logits =
        unpack<double>(archive.payload["calibration_logits"], path, "calibration_logits", {2});
    std::copy(logits.values.begin(), logits.values.end(), model.calibration.weights.begin() + 5);
  }
  read_numbers(archive.payload, "confidence_curve", path, model.confidence.weights);
  read_numbers(archive.payload, "character_curve", path, model.character.weights);
  read_numbers(archive.payload, "judge", path, model.judge.weights);
  return model;
}

void write_reader_model(const std::string& path, const ReaderModel& model,
                        const nlohmann::json& provenance) {
  Archive archive;
  archive.type = "plate-reader";
  archive.version = kVersion;
  archive.provenance = provenance;
  const CalibrationFeatures& weights = model.calibration.weights;
  archive.payload = {
      {"line", linalg::network_to_json(model.line)},
      {"calibration", pack(PackedArray<double>{{5}, {weights.begin(), weights.begin() + 5}})},
      {"calibration_logits", pack(PackedArray<double>{{2}, {weights.begin() + 5, weights.end()}})},
      {"confidence_curve", packed(model.confidence.weights)},
      {"character_curve", packed(model.character.weights)},
      {"judge", packed(model.judge.weights)}};
  write_archive(path, archive);
}

}  // namespace tarsier::plate
