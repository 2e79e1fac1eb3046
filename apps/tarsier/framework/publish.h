// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/crop_server.h"
#include "tarsier/mqtt/publisher.h"

#include "framework/cli.h"
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace tarsier::cli {

// Adds --mqtt-user, --mqtt-password-file, --mqtt-ca-file, --mqtt-cert and --mqtt-key. Returns them
// for grouping.
std::vector<Flag*> add_mqtt_login_flags(Command& verb, mqtt::Login& login);

struct PublishFlags {
  std::string address;
  mqtt::PublisherOptions options;
  CropServerOptions crops;
};

// Adds --publish and its flags. `kind` is the kind of the events, PublisherOptions::kind.
void add_publish_flags(Command& verb, PublishFlags& flags, const std::string& kind = "plate");

// Publishes events as --publish requests; empty without that flag.
class EventPublisher {
 public:
  // Checks the address and creates the outbox. `access`: who may fetch crops. Throws UsageError,
  // OutputError and what mqtt::Connection throws.
  EventPublisher(const PublishFlags& flags, const HttpAccess& access);
  explicit operator bool() const { return publisher_ != nullptr; }
  // Adds "last_seen", the time of day, if the event has none. With --crops and an image that is not
  // empty, also adds "crop": {"sha256","url"}.
  void post(nlohmann::ordered_json event, const cv::Mat& crop = {});
  void finish(bool interrupted);

 private:
  double finish_s_;
  std::unique_ptr<CropServer> crops_;
  std::unique_ptr<mqtt::Publisher> publisher_;
};

}  // namespace tarsier::cli
