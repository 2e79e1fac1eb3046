// SPDX-License-Identifier: MIT
#include "framework/publish.h"

#include "tarsier/media/atomic_file.h"

#include "framework/bind.h"
#include <filesystem>

namespace tarsier::cli {

std::vector<Flag*> add_mqtt_login_flags(Command& verb, mqtt::Login& login) {
  Flag& certificate = verb.add_option("--mqtt-cert", login.certificate,
                                      "PEM of this client's certificate, for mqtts:");
  Flag& key = verb.add_option("--mqtt-key", login.key, "PEM of its key");
  certificate.needs(key);
  key.needs(certificate);
  return {&verb.add_option("--mqtt-user", login.user, "where the address names none"),
          &verb.add_option("--mqtt-password-file", login.password_file,
                           "file whose first line is the password"),
          &verb.add_option("--mqtt-ca-file", login.ca_file,
                           "PEM of the authorities to trust for mqtts: [the system's]"),
          &certificate, &key};
}

void add_publish_flags(Command& verb, PublishFlags& flags) {
  const auto group = [](Flag& flag) -> Flag& { return flag.group("Publishing"); };
  Flag& publish = group(verb.add_option(
      "--publish", flags.address,
      "say events to an MQTT broker: mqtt://HOST[:PORT][/TOPIC], mqtts: by TLS; [tarsier/NAME of "
      "this machine]"));
  group(verb.add_option("--outbox", flags.options.outbox,
                        "SQLite file in which events wait until a hub has stored them [in "
                        "~/.local/state/tarsier]"))
      .needs(publish);
  group(bind_field(verb, flags.options, flags.options.max_events)).needs(publish);
  group(verb.add_flag("--homeassistant", flags.options.home_assistant,
                      "Home Assistant finds it by itself"))
      .needs(publish);
  for (Flag* flag : add_mqtt_login_flags(verb, flags.options.login)) group(*flag).needs(publish);
}

std::unique_ptr<mqtt::Publisher> make_publisher(const PublishFlags& flags) {
  if (flags.address.empty()) return nullptr;
  mqtt::PublisherOptions options = flags.options;
  options.address =
      mqtt::parse_address(flags.address, "tarsier/" + mqtt::machine_node_name(), "--publish");
  options.version = version();
  if (options.outbox.empty()) {
    options.outbox = mqtt::default_outbox(options.address.topic);
    make_folder(std::filesystem::path(options.outbox).parent_path().string());
  }
  return std::make_unique<mqtt::Publisher>(options);
}

}  // namespace tarsier::cli
