// SPDX-License-Identifier: MIT
#include "framework/on_event.h"

#include "tarsier/media/still_source.h"

#include "framework/bind.h"
#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier::cli {

Flag& add_on_event_flags(Command& verb, OnEventFlags& flags, const std::string& when) {
  Flag& command = verb.add_option("--on-event", flags.command,
                                  "program to run " + when + ", with the event as JSON on stdin");
  command.group("Events");
  bind_field(verb, flags.options, flags.options.timeout_s).needs(command).group("Events");
  return command;
}

OnEvent::OnEvent(const OnEventFlags& flags, const Context& context, const PublishFlags& publish,
                 const HttpAccess& access)
    : stop_(context.stop), publisher_(publish, access) {
  if (flags.command.empty()) return;
  EventCommandOptions options = flags.options;
  options.finish_s = options.timeout_s;
  options.name = "--on-event";
  command_.emplace(flags.command, options, context.stop);
}

void OnEvent::post(const nlohmann::ordered_json& event, const cv::Mat& crop) {
  if (command_) command_->post(json_text(event));
  publisher_.post(event, crop);
}

void OnEvent::finish() {
  if (command_) command_->finish();
  publisher_.finish(stop_.stop_requested());
}

PresenceEvents::PresenceEvents(OnEvent& on_event, std::string kind)
    : on_event_(on_event), kind_(std::move(kind)) {}

void PresenceEvents::frame(const Frame& frame, const nlohmann::ordered_json& seen) {
  if (!on_event_) return;
  std::vector<std::int64_t> ids;
  for (const nlohmann::ordered_json& object : seen) {
    ids.push_back(object.at("id"));
    if (object.contains("name")) names_[ids.back()] = object.at("name");
  }
  if (frame.still) {
    finish();
    for (const nlohmann::ordered_json& object : seen) post_appeared(frame, object);
    return;
  }
  for (const PresenceChange& change : presence_.step(source_of(frame), frame.time, ids)) {
    if (change.appeared) {
      const auto at = std::find(ids.begin(), ids.end(), change.id) - ids.begin();
      post_appeared(frame, seen.at(static_cast<std::size_t>(at)));
    } else {
      post_lost({change});
    }
  }
}

void PresenceEvents::finish() { post_lost(presence_.finish()); }

void PresenceEvents::post_lost(const std::vector<PresenceChange>& lost) {
  for (const PresenceChange& change : lost) {
    nlohmann::ordered_json event{{"event", kind_}, {"state", "lost"}, {"id", change.id}};
    if (names_.contains(change.id)) event["name"] = names_[change.id];
    event["source"] = change.source;
    event["first_time"] = change.first_time;
    event["last_time"] = change.last_time;
    on_event_.post(event);
  }
}

void PresenceEvents::post_appeared(const Frame& frame, const nlohmann::ordered_json& object) {
  nlohmann::ordered_json event{{"event", kind_}, {"state", "appeared"}};
  if (frame.still) {
    event["image"] = frame.name;
  } else {
    event.update({{"source", source_of(frame)}, {"frame", frame.index}, {"time", frame.time}});
  }
  event.update(object);
  on_event_.post(event);
}

}  // namespace tarsier::cli
