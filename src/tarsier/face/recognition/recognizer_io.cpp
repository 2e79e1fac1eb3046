// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/recognition/deep.h"
#include "tarsier/face/recognition/recognizer.h"
#include "tarsier/linalg/model_fields.h"

#include <nlohmann/json.hpp>
#include <stdexcept>

namespace tarsier::face::recognition {
namespace {

using nlohmann::json;

constexpr const char* kRecognizerType = "face-recognizer";
constexpr int kRecognizerVersion = 1;
constexpr std::int64_t kMaxPeople = 1'000'000;
constexpr std::size_t kMaxLabelBytes = 65'536;

void list_size(linalg::ModelFields& file, cv::Size& size) {
  file.whole("width", size.width, 0, 1024);
  file.whole("height", size.height, 0, 1024);
}

void list_options(linalg::ModelFields& file, RecognizerOptions& options) {
  file.named("algorithm", options.algorithm, parse_algorithm);
  list_size(file, options.size);
  file.whole("components", options.components, 0, 4096);
  file.part("lbp", options.lbp, [](linalg::ModelFields& lbp, LbpOptions& value) {
    lbp.whole("radius", value.radius, 1, 20);
    lbp.whole("neighbours", value.neighbours, 4, 10);
    lbp.whole("grid", value.grid, 1, 32);
  });
  file.part("descriptor", options.descriptor,
            [](linalg::ModelFields& part, DescriptorOptions& value) {
              list_size(part, value.size);
              part.flag("symmetric", value.symmetric);
              part.parts("channels", value.channels, 1, 8,
                         [](linalg::ModelFields& item, HogChannel& channel) {
                           item.named("light", channel.light, parse_light);
                           item.whole("cell", channel.cell, 4, 64);
                           item.whole("directions", channel.directions, 4, 32);
                           item.flag("full_circle", channel.full_circle);
                         });
            });
  file.number("variants", options.variants, 0, 4);
  file.number("ridge", options.ridge, 0, 100);
  file.number("mean_weight", options.mean_weight, 0, 1);
  if (file.reads()) options.check();
}

std::vector<std::string> labels_from_json(const json& payload, const std::string& path) {
  const json& labels = member(payload, "labels", path);
  if (!labels.is_array() || labels.size() > kMaxPeople)
    throw ModelError(path, "'labels' is not a list of names");
  std::vector<std::string> result;
  for (const auto& label : labels) {
    if (!label.is_string() || label.get_ref<const std::string&>().size() > kMaxLabelBytes)
      throw ModelError(path, "a label is not a text of at most 65536 bytes");
    result.push_back(label.get<std::string>());
  }
  return result;
}

void list_recognizer(linalg::ModelFields& file, Recognizer& model) {
  file.part("options", model.options, list_options);
  file.other("labels", model.labels, labels_from_json);
  if (model.options.algorithm != Algorithm::kLbph) {
    file.matrix("components", model.components, -1, -1);
    file.matrix("mean", model.mean, 1, model.components.cols());
    file.list<double>("importance", model.eigenvalues, model.components.rows());
  }
  if (is_whitened(model.options.algorithm))
    file.number("rest", model.residual_variance, 1e-30, 1e30);
  file.matrix("templates", model.templates, -1, model.template_length());
  file.list<std::int32_t>("people", model.people, model.templates.rows());
  std::int64_t network = model.network ? model.network->fingerprint : model.network_fingerprint;
  if (file.has("network", network != 0)) file.whole("network", network, 0);
  if (file.reads()) model.network_fingerprint = network;
  file.optional("calibration", model.calibration, calibration_from_json);
}

Recognizer from_payload(const json& payload, const std::string& path) {
  auto model = linalg::read_fields<Recognizer>(payload, path, list_recognizer);
  model.check();
  model.refresh();
  return model;
}

json to_payload(const Recognizer& model) {
  model.check();
  return linalg::written(model, list_recognizer);
}

}  // namespace

void write_recognizer(const std::string& path, const Recognizer& model, const json& provenance) {
  write_archive(path, {kRecognizerType, kRecognizerVersion, provenance, to_payload(model)});
}

std::string recognizer_text(const Recognizer& model) { return to_payload(model).dump(); }

Recognizer recognizer_from_text(std::string_view text, const std::string& path) {
  try {
    return from_payload(parse_json(text, path), path);
  } catch (const InputError& error) {
    throw ModelError(path, error.what());
  } catch (const std::invalid_argument& error) {
    throw ModelError(path, error.what());
  }
}

Recognizer read_recognizer(const std::string& path) {
  const Archive archive = read_archive(path, kRecognizerType, kRecognizerVersion);
  try {
    return from_payload(archive.payload, path);
  } catch (const std::invalid_argument& error) {
    throw ModelError(path, error.what());
  }
}

}  // namespace tarsier::face::recognition
