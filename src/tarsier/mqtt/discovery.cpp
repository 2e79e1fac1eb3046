// SPDX-License-Identifier: MIT
#include "tarsier/mqtt/discovery.h"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace tarsier::mqtt {

std::vector<Message> home_assistant_discovery(const std::string& topic,
                                              const std::string& version) {
  std::string id = topic;
  std::replace_if(
      id.begin(), id.end(),
      [](char c) {
        return !((c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9'));
      },
      '_');
  const nlohmann::ordered_json device{
      {"identifiers", {id}}, {"name", topic}, {"manufacturer", "Tarsier"}, {"sw_version", version}};
  const auto base = [&](const char* kind, const char* name) {
    return nlohmann::ordered_json{{"name", name},
                                  {"unique_id", id + '_' + kind},
                                  {"state_topic", topic + "/events"},
                                  {"availability_topic", topic + "/state"},
                                  {"availability_template", "{{ value_json.state }}"},
                                  {"payload_available", "online"},
                                  {"payload_not_available", "offline"},
                                  {"device", device}};
  };
  nlohmann::ordered_json plate = base("plate", "Plate");
  plate["value_template"] = "{{ value_json.event.text }}";
  plate["json_attributes_topic"] = topic + "/events";
  plate["json_attributes_template"] = "{{ value_json.event | tojson }}";
  plate["icon"] = "mdi:car";
  nlohmann::ordered_json watch = base("watch", "Watched plate");
  watch["value_template"] = "{{ 'ON' if value_json.event.watch else 'OFF' }}";
  watch["off_delay"] = 10;
  return {{"homeassistant/sensor/" + id + "_plate/config", plate.dump(), true},
          {"homeassistant/binary_sensor/" + id + "_watch/config", watch.dump(), true}};
}

}  // namespace tarsier::mqtt
