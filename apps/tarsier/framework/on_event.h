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
#include <nlohmann/json.hpp>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::cli {

struct OnEventFlags {
  std::string command;
  EventCommandOptions options;
};

// --on-event, which is returned, and --on-event-timeout. `when`: "at each new recognition".
Flag& add_on_event_flags(Command& verb, OnEventFlags& flags, const std::string& when);

// The command of --on-event and the broker of --publish, those that there are. Posting to a command
// never waits; see media/event_command.h.
class OnEvent {
 public:
  OnEvent(const OnEventFlags& flags, const Context& context, const PublishFlags& publish = {},
          const HttpAccess& access = {});
  // Whether anybody wants to know.
  explicit operator bool() const { return command_ || publisher_; }
  // `crop` may be empty; see EventPublisher.
  void post(const nlohmann::ordered_json& event, const cv::Mat& crop = {});
  // Waits for what is on its way, as long as one command may take.
  void finish();

 private:
  std::stop_token stop_;
  std::optional<EventCommand> command_;
  EventPublisher publisher_;
};

// Of stills each object that is seen, of videos those that appear and are lost: {"event": `kind`,
// "state": "appeared" or "lost", ..}.
class PresenceEvents {
 public:
  // `on_event` must outlive it.
  PresenceEvents(OnEvent& on_event, std::string kind);
  // `seen`: a list of objects with "id", and "name" where the objects have one.
  void frame(const Frame& frame, const nlohmann::ordered_json& seen);
  void finish();

 private:
  void post_lost(const std::vector<PresenceChange>& lost);
  void post_appeared(const Frame& frame, const nlohmann::ordered_json& object);

  OnEvent& on_event_;
  std::string kind_;
  Presence presence_;
  std::map<std::int64_t, std::string> names_;  // as they were when last seen
};

}  // namespace tarsier::cli
