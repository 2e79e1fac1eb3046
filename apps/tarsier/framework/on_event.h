// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/event_command.h"
#include "tarsier/media/frame.h"

#include "framework/cli.h"
#include "framework/publish.h"
#include "ui/face/presence.h"
#include <cstdint>
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::cli {

struct OnEventFlags {
  std::string command;
  EventCommandOptions options;
};

// Adds --on-event and --on-event-timeout; returns --on-event. `when`: "at each new recognition".
Flag& add_on_event_flags(Command& verb, OnEventFlags& flags, const std::string& when);

// Sends events to the command of --on-event and to the broker of --publish, if they are given.
// Posting to a command never waits; see media/event_command.h.
class OnEvent {
 public:
  OnEvent(const OnEventFlags& flags, const Context& context, const PublishFlags& publish = {},
          const HttpAccess& access = {});
  // Whether there is a command or a broker.
  explicit operator bool() const { return command_ || publisher_; }
  // `crop` may be empty; see EventPublisher.
  void post(const nlohmann::ordered_json& event, const cv::Mat& crop = {});
  // Waits for pending events, at most as long as one command may take.
  void finish();

 private:
  std::stop_token stop_;
  std::optional<EventCommand> command_;
  EventPublisher publisher_;
};

// Events {"event": `kind`, "state": "appeared" or "lost", ..}. For stills: each object that is
// seen. For videos: objects that appear and objects that are lost.
class PresenceEvents {
 public:
  // `on_event` must outlive it.
  PresenceEvents(OnEvent& on_event, std::string kind);
  // `seen` is a list of objects with "id", and "name" if they have one.
  void frame(const Frame& frame, const nlohmann::ordered_json& seen);
  void finish();

 private:
  void post_lost(const std::vector<PresenceChange>& lost);
  void post_appeared(const Frame& frame, const nlohmann::ordered_json& object);

  OnEvent& on_event_;
  std::string kind_;
  Presence presence_;
  std::map<std::int64_t, std::string> names_;  // the last known names
};

}  // namespace tarsier::cli
