// SPDX-License-Identifier: MIT
#include "tarsier/linalg/model_fields.h"

#include <nlohmann/json.hpp>

namespace tarsier::linalg {

void ModelFields::number(const char* name, double& value, double low, double high) {
  if (reads()) {
    value = number_member(*from_, name, path_, low, high);
  } else {
    to_[name] = value;
  }
}

void ModelFields::number(const char* name, float& value, double low, double high) {
  if (reads()) {
    value = static_cast<float>(number_member(*from_, name, path_, low, high));
  } else {
    to_[name] = value;
  }
}

void ModelFields::flag(const char* name, bool& value) {
  if (!reads()) {
    to_[name] = value;
    return;
  }
  const nlohmann::json& found = member(*from_, name, path_);
  if (!found.is_boolean()) throw ModelError(path_, fmt::format("'{}' is not true or false", name));
  value = found.get<bool>();
}

void ModelFields::text(const char* name, std::string& value, std::size_t max_bytes) {
  if (reads()) {
    value = text_member(*from_, name, path_, max_bytes);
  } else {
    to_[name] = value;
  }
}

void ModelFields::network(const char* name, Network& value, Precision precision) {
  if (reads()) {
    value = network_from_json(member(*from_, name, path_), path_);
  } else {
    to_[name] = network_to_json(value, precision);
  }
}

const nlohmann::json& ModelFields::list_of(const char* name, std::size_t min,
                                           std::size_t max) const {
  const nlohmann::json& items = member(*from_, name, path_);
  if (!items.is_array() || items.size() < min || items.size() > max)
    throw ModelError(path_, fmt::format("{}: a list of {} to {} is expected", name, min, max));
  return items;
}

}  // namespace tarsier::linalg
