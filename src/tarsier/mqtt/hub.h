// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/sqlite.h"
#include "tarsier/mqtt/address.h"
#include "tarsier/mqtt/outbox.h"

#include <cstdint>
#include <functional>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::mqtt {

// The events of all nodes in one SQLite file. Each is there once, however often it comes.
class HubLog {
 public:
  // Throws as media/sqlite.h says.
  explicit HubLog(const std::string& path, DatabaseAccess access = DatabaseAccess::kCreate);

  // Of this file and no other.
  [[nodiscard]] const std::string& id() const { return id_; }

  // Several messages together: on the disk when it returns. Returns for each whether it was new.
  struct Received {
    std::string node;
    EventMessage message;
  };
  std::vector<bool> store(const std::vector<Received>& received, std::int64_t now_ms);

  // How far the events of a node's outbox are here without a gap.
  [[nodiscard]] std::int64_t mark(const std::string& node, const std::string& outbox);
  // The latest mark of each node.
  [[nodiscard]] std::vector<std::pair<std::string, Mark>> marks();

  [[nodiscard]] std::int64_t count();
  // Calls take() with node and JSON of each event in the order in which they came.
  void read(const std::function<bool(const std::string& node, const std::string& event)>& take);

 private:
  Database database_;
  std::string id_;
};

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
