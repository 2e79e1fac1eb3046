// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/mqtt/publisher.h"

#include "framework/cli.h"
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tarsier::cli {

// --mqtt-user, --mqtt-password-file, --mqtt-ca-file, --mqtt-cert and --mqtt-key. Returns them, to
// be grouped.
std::vector<Flag*> add_mqtt_login_flags(Command& verb, mqtt::Login& login);

struct PublishFlags {
  std::string address;
  mqtt::PublisherOptions options;
};

// --publish and what belongs to it.
void add_publish_flags(Command& verb, PublishFlags& flags);

// What --publish asks for, if it was given: the address is checked, the outbox made. Throws
// UsageError, OutputError and what mqtt::Connection throws.
[[nodiscard]] std::unique_ptr<mqtt::Publisher> make_publisher(const PublishFlags& flags);

}  // namespace tarsier::cli
