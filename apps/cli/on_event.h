// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/event_command.h"

#include "cli.h"
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace tarsier::cli {

struct OnEventFlags {
  std::string command;
  EventCommandOptions options;
};

// --on-event and --on-event-timeout. `when`: "at each new recognition".
void add_on_event_flags(Command& verb, OnEventFlags& flags, const std::string& when);

// The command of --on-event, if there is one. Posting never waits; see io/event_command.h.
class OnEvent {
 public:
  OnEvent(const OnEventFlags& flags, const Context& context);
  // Whether anybody wants to know.
  explicit operator bool() const { return command_.has_value(); }
  void post(const nlohmann::ordered_json& event);
  // Waits for what is on its way, as long as one command may take.
  void finish();

 private:
  std::optional<EventCommand> command_;
};

}  // namespace tarsier::cli
