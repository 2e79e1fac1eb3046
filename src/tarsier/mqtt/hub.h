// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/mqtt/address.h"
#include "tarsier/mqtt/hub_log.h"

#include <functional>
#include <stop_token>
#include <string>

namespace tarsier::mqtt {

struct HubOptions {
  Address address;  // of the topic above the nodes': TOPIC/+/events
  Login login;
  // Called for each event that was not stored before, after it is.
  std::function<void(const std::string& node, const std::string& event)> take;
};

// Stores what the nodes publish and says at TOPIC/NODE/acked (retained) how far, until `stop`. A
// broker that is away is waited for. Throws as HubLog and Connection.
void run_hub(HubLog& log, const HubOptions& options, const std::stop_token& stop);

// The node of "TOPIC/NODE/events"; empty for any other topic.
[[nodiscard]] std::string node_of(const std::string& topic, const std::string& above);

}  // namespace tarsier::mqtt
