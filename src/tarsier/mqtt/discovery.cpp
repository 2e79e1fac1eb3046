// SPDX-License-Identifier: MIT
#include "tarsier/mqtt/discovery.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <iterator>
#include <nlohmann/json.hpp>

namespace tarsier::mqtt {

std::vector<Message> home_assistant_discovery(const std::string& topic, const std::string& version,
                                              const std::string& kind) {
  std::string id = topic;
  std::replace_if(
      id.begin(), id.end(),
      [](char c) {
        return !((c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9'));
      },
      '_');
  const nlohmann::ordered_json device{
      {"identifiers", {id}}, {"name", topic}, {"manufacturer", "Tarsier"}, {"sw_version", version}};
  const auto base = [&](const std::string& what, const std::string& name) {
    return nlohmann::ordered_json{{"name", name},
                                  {"unique_id", id + '_' + what},
                                  {"state_topic", topic + "/events"},
                                  {"availability_topic", topic + "/state"},
                                  {"availability_template", "{{ value_json.state }}"},
                                  {"payload_available", "online"},
                                  {"payload_not_available", "offline"},
                                  {"device", device}};
  };
  struct SensorConfig {
    const char* kind;
    const char* name;
    const char* value;
    const char* icon;
  };
  static constexpr SensorConfig kSensors[] = {
      {"plate", "Plate", "{{ value_json.event.text }}", "mdi:car"},
      {"person", "Person", "{{ value_json.event.label }}", "mdi:account"},
      {"marker", "Marker", "{{ value_json.event.id }}", "mdi:qrcode"},
      {"target", "Target", "{{ value_json.event.name }}", "mdi:image-search"}};
  const auto* sensor = std::find_if(std::begin(kSensors), std::end(kSensors),
                                    [&](const SensorConfig& one) { return one.kind == kind; });
  TARSIER_REQUIRE(sensor != std::end(kSensors), "unknown kind of events '{}'", kind);
  nlohmann::ordered_json last = base(kind, sensor->name);
  last["value_template"] = sensor->value;
  last["json_attributes_topic"] = topic + "/events";
  last["json_attributes_template"] = "{{ value_json.event | tojson }}";
  last["icon"] = sensor->icon;
  std::vector<Message> messages{
      {"homeassistant/sensor/" + id + "_" + kind + "/config", last.dump(), true}};
  if (kind != "plate") return messages;
  nlohmann::ordered_json watch = base("watch", "Watched plate");
  watch["value_template"] = "{{ 'ON' if value_json.event.watch else 'OFF' }}";
  watch["off_delay"] = 10;
  messages.push_back({"homeassistant/binary_sensor/" + id + "_watch/config", watch.dump(), true});
  return messages;
}

}  // namespace tarsier::mqtt
