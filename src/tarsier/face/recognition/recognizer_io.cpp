// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/recognition/deep.h"
#include "tarsier/face/recognition/packed_rows.h"
#include "tarsier/face/recognition/recognizer.h"
#include "tarsier/media/archive.h"

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

namespace tarsier::face::recognition {
namespace {

using nlohmann::json;

constexpr const char* kType = "face-recognizer";
constexpr int kVersion = 1;
constexpr std::int64_t kMaxPeople = 1'000'000;
constexpr std::size_t kMaxLabelBytes = 65'536;

bool bool_member(const json& object, const std::string& name, const std::string& path) {
  const json& value = member(object, name, path);
  if (!value.is_boolean()) throw ModelError(path, "'" + name + "' is not true or false");
  return value.get<bool>();
}

int int_member(const json& object, const std::string& name, const std::string& path,
               std::int64_t low, std::int64_t high) {
  return static_cast<int>(integer_member(object, name, path, low, high));
}

cv::Size size_member(const json& object, const std::string& path) {
  return {int_member(object, "width", path, 0, 1024), int_member(object, "height", path, 0, 1024)};
}

json options_json(const RecognizerOptions& options) {
  json channels = json::array();
  for (const auto& channel : options.descriptor.channels) {
    channels.push_back({{"light", name_of(channel.light)},
                        {"cell", channel.cell},
                        {"directions", channel.directions},
                        {"full_circle", channel.full_circle}});
  }
  return {{"algorithm", name_of(options.algorithm)},
          {"width", options.size.width},
          {"height", options.size.height},
          {"components", options.components},
          {"lbp",
           {{"radius", options.lbp.radius},
            {"neighbours", options.lbp.neighbours},
            {"grid", options.lbp.grid}}},
          {"descriptor",
           {{"width", options.descriptor.size.width},
            {"height", options.descriptor.size.height},
            {"symmetric", options.descriptor.symmetric},
            {"channels", std::move(channels)}}},
          {"variants", options.variants},
          {"ridge", options.ridge},
          {"mean_weight", options.mean_weight}};
}

RecognizerOptions options_from_json(const json& value, const std::string& path) {
  RecognizerOptions options;
  options.algorithm = parse_algorithm(text_member(value, "algorithm", path));
  options.size = size_member(value, path);
  options.components = int_member(value, "components", path, 0, 4096);
  const json& lbp = member(value, "lbp", path);
  options.lbp.radius = int_member(lbp, "radius", path, 1, 20);
  options.lbp.neighbours = int_member(lbp, "neighbours", path, 4, 10);
  options.lbp.grid = int_member(lbp, "grid", path, 1, 32);
  const json& descriptor = member(value, "descriptor", path);
  options.descriptor.size = size_member(descriptor, path);
  options.descriptor.symmetric = bool_member(descriptor, "symmetric", path);
  const json& channels = member(descriptor, "channels", path);
  if (!channels.is_array() || channels.empty() || channels.size() > 8)
    throw ModelError(path, "'channels' is not a list of 1 to 8");
  options.descriptor.channels.clear();
  for (const auto& channel : channels) {
    HogChannel& out = options.descriptor.channels.emplace_back();
    out.light = parse_light(text_member(channel, "light", path));
    out.cell = int_member(channel, "cell", path, 4, 64);
    out.directions = int_member(channel, "directions", path, 4, 32);
    out.full_circle = bool_member(channel, "full_circle", path);
  }
  options.variants = number_member(value, "variants", path, 0, 4);
  options.ridge = number_member(value, "ridge", path, 0, 100);
  options.mean_weight = number_member(value, "mean_weight", path, 0, 1);
  options.check();
  return options;
}

Recognizer from_payload(const json& payload, const std::string& path) {
  Recognizer model;
  model.options = options_from_json(member(payload, "options", path), path);
  const json& labels = member(payload, "labels", path);
  if (!labels.is_array() || labels.size() > kMaxPeople)
    throw ModelError(path, "'labels' is not a list of names");
  for (const auto& label : labels) {
    if (!label.is_string() || label.get_ref<const std::string&>().size() > kMaxLabelBytes)
      throw ModelError(path, "a label is not a text of at most 65536 bytes");
    model.labels.push_back(label.get<std::string>());
  }
  if (model.options.algorithm != Algorithm::kLbph) {
    model.components = unpacked(payload, "components", path, -1, -1);
    model.mean = unpacked(payload, "mean", path, 1, model.components.cols());
    const auto importance = unpack<double>(member(payload, "importance", path), path, "importance",
                                           {model.components.rows()});
    model.importance = Eigen::Map<const Eigen::VectorXd>(
        importance.values.data(), static_cast<Eigen::Index>(importance.values.size()));
  }
  if (is_whitened(model.options.algorithm))
    model.rest = number_member(payload, "rest", path, 1e-30, 1e30);
  model.templates = unpacked(payload, "templates", path, -1, model.template_length());
  const auto people = unpack<std::int32_t>(member(payload, "people", path), path, "people",
                                           {model.templates.rows()});
  model.people.assign(people.values.begin(), people.values.end());
  if (payload.contains("network"))
    model.of_network =
        integer_member(payload, "network", path, 0, std::numeric_limits<std::int64_t>::max());
  if (payload.contains("calibration"))
    model.calibration = calibration_from_json(payload["calibration"], path);
  model.check();
  model.refresh();
  return model;
}

json to_payload(const Recognizer& model) {
  model.check();
  json payload = {{"options", options_json(model.options)}, {"labels", model.labels}};
  if (model.options.algorithm != Algorithm::kLbph) {
    payload["components"] = packed(model.components);
    payload["mean"] = packed(Rows(model.mean));
    payload["importance"] = pack(PackedArray<double>{
        {model.importance.size()},
        {model.importance.data(), model.importance.data() + model.importance.size()}});
  }
  if (is_whitened(model.options.algorithm)) payload["rest"] = model.rest;
  payload["templates"] =
      packed(model.templates.rows() > 0 ? model.templates : Rows(0, model.template_length()));
  payload["people"] =
      pack(PackedArray<std::int32_t>{{static_cast<std::int64_t>(model.people.size())},
                                     {model.people.begin(), model.people.end()}});
  if (const std::int64_t network = model.network ? model.network->fingerprint : model.of_network;
      network != 0)
    payload["network"] = network;
  if (model.calibration) payload["calibration"] = to_json(*model.calibration);
  return payload;
}

}  // namespace

void write_recognizer(const std::string& path, const Recognizer& model, const json& provenance) {
  write_archive(path, {kType, kVersion, provenance, to_payload(model)});
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
  const Archive archive = read_archive(path, kType, kVersion);
  try {
    return from_payload(archive.payload, path);
  } catch (const std::invalid_argument& error) {
    throw ModelError(path, error.what());
  }
}

}  // namespace tarsier::face::recognition
