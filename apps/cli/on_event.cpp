// SPDX-License-Identifier: MIT
#include "on_event.h"

namespace tarsier::cli {

void add_on_event_flags(Command& verb, OnEventFlags& flags, const std::string& when) {
  Flag& command = verb.add_option("--on-event", flags.command,
                                  "program to run " + when + ", with its JSON on stdin");
  command.group("Events");
  verb.add_option("--on-event-timeout", flags.options.timeout_s,
                  "s after which it is killed; at the end events get as long in all")
      .check(range(0.01, 3600.0))
      .needs(command)
      .show_default()
      .group("Events");
}

OnEvent::OnEvent(const OnEventFlags& flags, const Context& context) {
  if (flags.command.empty()) return;
  EventCommandOptions options = flags.options;
  options.finish_s = options.timeout_s;
  command_.emplace(flags.command, options, context.stop);
}

void OnEvent::post(const nlohmann::ordered_json& event) {
  if (command_) command_->post(json_text(event));
}

void OnEvent::finish() {
  if (command_) command_->finish();
}

}  // namespace tarsier::cli
