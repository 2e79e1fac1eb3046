// SPDX-License-Identifier: MIT
#include "tarsier/mqtt/hub.h"

#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"

#include <fmt/format.h>

#include "framework/cli.h"
#include "framework/publish.h"
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

namespace tarsier::cli {
namespace {

struct HubFlags {
  std::string address;
  std::string log;
  bool list = false;
  mqtt::Login login;
};

void print_event(const std::string& node, const std::string& event, const Context& context) {
  nlohmann::ordered_json object = nlohmann::ordered_json::parse(event, nullptr, false);
  if (!object.is_object()) return;
  if (context.json) {
    nlohmann::ordered_json line{{"node", node}};
    line.update(object);
    print_json(line);
    return;
  }
  const auto text = [&](const char* name) {
    const auto at = object.find(name);
    return at != object.end() && at->is_string() ? printable(at->get<std::string>()) : "";
  };
  // A plate's text, a person's or target's name, or a marker's number.
  std::string what = text("text") + text("label") + text("name");
  if (what.empty() && object.contains("id")) what = object["id"].dump();
  print_text(fmt::format("{}  {:<16} {:<9} {:<10} {}\n", text("last_seen").substr(0, 19), node,
                         text("state"), what, text("source")));
}

ExitStatus run_hub(const HubFlags& flags, const Context& context) {
  mqtt::HubOptions options;
  if (!flags.list) {
    if (flags.address.empty()) throw UsageError("ADDRESS is missing: mqtt://HOST, or --list");
    options.address = mqtt::parse_address(flags.address, "tarsier", "ADDRESS");
    options.login = flags.login;
    options.on_event = [&](const std::string& node, const std::string& event) {
      if (!context.quiet || context.json) print_event(node, event, context);
    };
    const auto log = mqtt::open_hub_log(flags.log);
    mqtt::run_hub(*log, options, context.stop);
    return ExitStatus::kInterrupted;
  }
  const auto log = mqtt::open_hub_log(flags.log, DatabaseAccess::kRead);
  bool found = false;
  log->read([&](const std::string& node, const std::string& event) {
    throw_if_stopped(context.stop);
    print_event(node, event, context);
    found = true;
    return true;
  });
  return found ? ExitStatus::kDone : ExitStatus::kNothingFound;
}

void add_flags(Command& verb, HubFlags& flags) {
  verb.add_option(
      "ADDRESS", flags.address,
      "mqtt://HOST[:PORT][/TOPIC], mqtts: with TLS; stores the events of TOPIC/+ [tarsier]");
  verb.add_option("--log", flags.log,
                  "SQLite file, or postgresql://HOST/DATABASE, that stores each event once")
      .required();
  verb.add_flag("--list", flags.list,
                "list the stored events and exit, without a connection to the broker");
  for (Flag* flag : add_mqtt_login_flags(verb, flags.login)) flag->group("Login");
}

}  // namespace

void add_hub(Command& app, Context& context) {
  add_verb<HubFlags>(app, "hub", "store the events that many cameras publish (MQTT)", context,
                     add_flags, run_hub);
}

}  // namespace tarsier::cli
