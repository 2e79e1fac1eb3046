// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/mqtt/address.h"
#include "tarsier/mqtt/hub_log.h"

#include <functional>
#include <stop_token>
#include <string>

namespace tarsier::mqtt {

struct HubOptions {
  Address address;  // its topic is the parent of the nodes' topics: TOPIC/+/events
  Login login;
  // Called for each event that is new, after it was stored.
  std::function<void(const std::string& node, const std::string& event)> on_event;
};

// Stores what the nodes publish until `stop` is triggered. Publishes the progress at
// TOPIC/NODE/acked (retained). Waits for a broker that is not available. Throws as HubLog and
// Connection do.
void run_hub(HubLog& log, const HubOptions& options, const std::stop_token& stop);

// The node of "TOPIC/NODE/events"; empty for any other topic.
[[nodiscard]] std::string node_of(const std::string& topic, const std::string& parent);

}  // namespace tarsier::mqtt
