// SPDX-License-Identifier: MIT
#include "framework/publish.h"

#include "tarsier/core/log.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/plate/tracking/time_text.h"

#include "framework/bind.h"
#include <filesystem>
#include <nlohmann/json.hpp>

namespace tarsier::cli {

namespace fs = std::filesystem;

namespace {

// For pending events, instead of PublisherOptions::finish_s.
constexpr double kInterruptedFinish_s = 1;

}  // namespace

std::vector<Flag*> add_mqtt_login_flags(Command& verb, mqtt::Login& login) {
  Flag& certificate =
      verb.add_option("--mqtt-cert", login.certificate, "client certificate for mqtts: (PEM)");
  Flag& key = verb.add_option("--mqtt-key", login.key, "key of the client certificate (PEM)");
  certificate.needs(key);
  key.needs(certificate);
  return {&verb.add_option("--mqtt-user", login.user, "user name, if the address has none"),
          &verb.add_option("--mqtt-password-file", login.password_file,
                           "file with the password in its first line"),
          &verb.add_option("--mqtt-ca-file", login.ca_file,
                           "trusted certificate authorities for mqtts: (PEM) [the system's]"),
          &certificate, &key};
}

void add_publish_flags(Command& verb, PublishFlags& flags, const std::string& kind) {
  flags.options.kind = kind;
  const auto group = [](Flag& flag) -> Flag& { return flag.group("Publishing"); };
  Flag& publish = group(verb.add_option(
      "--publish", flags.address,
      "publish events by MQTT: mqtt://HOST[:PORT][/TOPIC], mqtts: with TLS [tarsier/HOSTNAME]"));
  group(verb.add_option(
            "--outbox", flags.options.outbox,
            "SQLite queue of events until a hub has stored them [in ~/.local/state/tarsier]"))
      .needs(publish);
  group(bind_field(verb, flags.options, flags.options.max_events)).needs(publish);
  group(verb.add_flag("--homeassistant", flags.options.home_assistant,
                      "announce to Home Assistant by MQTT discovery"))
      .needs(publish);
  Flag& crops = group(verb.add_option("--crops", flags.crops.url,
                                      "address that serves the crops of events by hash: "
                                      "http://127.0.0.1:8090/; for others see --listen-all"));
  crops.needs(publish);
  group(
      verb.add_option("--crops-dir", flags.crops.folder, "folder of the crops [beside the outbox]"))
      .needs(crops);
  group(bind_field(verb, flags.crops, flags.crops.max_crops)).needs(crops);
  for (Flag* flag : add_mqtt_login_flags(verb, flags.options.login)) group(*flag).needs(publish);
}

EventPublisher::EventPublisher(const PublishFlags& flags, const HttpAccess& access)
    : finish_s_(flags.options.finish_s) {
  if (flags.address.empty()) return;
  mqtt::PublisherOptions options = flags.options;
  options.address =
      mqtt::parse_address(flags.address, "tarsier/" + mqtt::machine_node_name(), "--publish");
  options.version = version();
  if (options.outbox.empty()) {
    options.outbox = mqtt::default_outbox(options.address.topic);
    make_folder(fs::path(options.outbox).parent_path().string());
  }
  if (!flags.crops.url.empty()) {
    CropServerOptions crops = flags.crops;
    crops.access = access;
    if (crops.folder.empty()) crops.folder = options.outbox + ".crops";
    crops_ = std::make_unique<CropServer>(crops);
    log_info("crops of events are at {}", crops_->url_of("SHA256"));
  }
  publisher_ = std::make_unique<mqtt::Publisher>(options);
}

void EventPublisher::post(nlohmann::ordered_json event, const cv::Mat& crop) {
  if (!publisher_) return;
  if (!event.contains("last_seen")) event["last_seen"] = plate::moment_text(plate::moment_now());
  if (crops_ && !crop.empty()) {
    const std::string hash = crops_->add(crop);
    event["crop"] = {{"sha256", hash}, {"url", crops_->url_of(hash)}};
  }
  publisher_->post(json_text(event));
}

void EventPublisher::finish(bool interrupted) {
  if (publisher_) publisher_->finish(interrupted ? kInterruptedFinish_s : finish_s_);
}

}  // namespace tarsier::cli
