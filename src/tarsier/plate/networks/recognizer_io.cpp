// SPDX-License-Identifier: MIT
#include "tarsier/linalg/model_fields.h"
#include "tarsier/plate/networks/recognizer.h"

#include <nlohmann/json.hpp>
#include <span>

namespace tarsier::plate {
namespace {

constexpr int kVersion = 1;

// A network that maps `input` to `output`.
void list_network(linalg::ModelFields& file, const char* name, linalg::Network& network,
                  linalg::Shape input, linalg::Shape output) {
  file.network(name, network);
  if (!file.reads()) return;
  linalg::Shape actual;
  try {
    actual = network.output(input);
  } catch (const std::exception& error) {
    file.require(false, "{}: {}", name, error.what());
  }
  file.require(actual == output && network.cost(input) <= 2e9, "{}: is not a network for this",
               name);
}

void list_detector(linalg::ModelFields& file, DetectorModel& model) {
  list_network(file, "detector", model.detector, {1, 10 * kCellSize, 20 * kCellSize}, {9, 10, 20});
  list_network(file, "aligner", model.aligner, {1, kAlignHeight, kAlignWidth}, {18, 1, 1});
}

void list_reader(linalg::ModelFields& file, ReaderModel& model) {
  list_network(file, "line", model.line, {1, kLineHeight, kLineWidth},
               {kClasses, 1, kLineWidth / kColumnStride});
  const std::span weights(model.calibration.weights);
  auto features = weights.first(5);
  auto logits = weights.subspan(5);
  file.list<double>("calibration", features, 5);
  // Older models lack some of these; then the defaults stay.
  const auto newer = [&](const char* name, auto& numbers) {
    if (file.has(name, true))
      file.list<double>(name, numbers, static_cast<std::int64_t>(numbers.size()));
  };
  newer("calibration_logits", logits);
  newer("confidence_curve", model.confidence_curve.weights);
  newer("character_curve", model.character_curve.weights);
  newer("judge", model.plate_classifier.weights);
}

}  // namespace

DetectorModel read_detector_model(const std::string& path) {
  return linalg::read_fields<DetectorModel>(read_archive(path, "plate-detector", kVersion).payload,
                                            path, list_detector);
}

void write_detector_model(const std::string& path, const DetectorModel& model,
                          const nlohmann::json& provenance) {
  write_archive(path,
                {"plate-detector", kVersion, provenance, linalg::written(model, list_detector)});
}

ReaderModel read_reader_model(const std::string& path) {
  return linalg::read_fields<ReaderModel>(read_archive(path, "plate-reader", kVersion).payload,
                                          path, list_reader);
}

void write_reader_model(const std::string& path, const ReaderModel& model,
                        const nlohmann::json& provenance) {
  write_archive(path, {"plate-reader", kVersion, provenance, linalg::written(model, list_reader)});
}

}  // namespace tarsier::plate
