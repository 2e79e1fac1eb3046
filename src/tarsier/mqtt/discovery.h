// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/mqtt/connection.h"

#include <string>
#include <vector>

namespace tarsier::mqtt {

// Retained messages by which Home Assistant discovers a node. They define a sensor with the last
// plate's text, person's name or marker's number, as `kind` says (plate, person, marker, target).
// For plates they also define a binary sensor that is on for ten seconds when a plate of the watch
// list is seen. `topic` is the node's, "tarsier/gate".
[[nodiscard]] std::vector<Message> home_assistant_discovery(const std::string& topic,
                                                            const std::string& version,
                                                            const std::string& kind);

}  // namespace tarsier::mqtt
