// SPDX-License-Identifier: MIT
#include "ui/scripted_host.h"

#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"

#include <fmt/format.h>

#include <chrono>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

namespace tarsier {
namespace {

constexpr NameTable<Event::Mouse, 9> kMouseEvents{"event of the mouse",
                                                  {{{Event::Mouse::kMove, "move"},
                                                    {Event::Mouse::kLeftDown, "left-down"},
                                                    {Event::Mouse::kLeftUp, "left-up"},
                                                    {Event::Mouse::kRightDown, "right-down"},
                                                    {Event::Mouse::kRightUp, "right-up"},
                                                    {Event::Mouse::kMiddleDown, "middle-down"},
                                                    {Event::Mouse::kMiddleUp, "middle-up"},
                                                    {Event::Mouse::kWheel, "wheel"},
                                                    {Event::Mouse::kDouble, "double"}}}};

std::string_view name_of(Event::Mouse mouse) { return kMouseEvents.name(mouse); }

}  // namespace

std::string describe(const Event& event) {
  switch (event.kind) {
    case Event::Kind::kKey:
      if (event.key > 32 && event.key < 127)
        return fmt::format("key {}", static_cast<char>(event.key));
      return fmt::format("key {}", event.key);
    case Event::Kind::kMouse:
      return fmt::format("mouse {} {:g} {:g}", name_of(event.mouse), event.x, event.y);
    case Event::Kind::kAction:
      return "action " + event.name;
    case Event::Kind::kSlider:
      return fmt::format("slider {} {:g}", event.name, event.value);
  }
  return "unknown";
}

void ScriptedHost::schedule(std::int64_t frame, Event event) {
  TARSIER_REQUIRE(frame >= 0, "frame {}", frame);
  events_[frame].push_back(std::move(event));
}

void ScriptedHost::keep_images(std::int64_t frame) { kept_frames_.insert(frame); }

bool ScriptedHost::record(View view, std::string cause, const Frame* frame) {
  ScriptStep step;
  step.frame = frame_count_ - 1;
  step.cause = std::move(cause);
  step.status = std::move(view.status);
  step.state = std::move(view.state);
  step.finished = view.finished;
  step.toggle_fullscreen = view.toggle_fullscreen;
  if (sink_ != nullptr && frame != nullptr && !view.output.empty())
    step.written = sink_->write(view.output, *frame);
  if (kept_frames_.contains(step.frame)) {
    step.image = view.image.clone();
    step.output = view.output.clone();
  }
  const bool finished = step.finished;
  steps_.push_back(std::move(step));
  return finished;
}

bool ScriptedHost::send_events(std::int64_t before) {
  while (!events_.empty() && events_.begin()->first <= before) {
    const std::vector<Event> events = std::move(events_.begin()->second);
    events_.erase(events_.begin());
    for (const Event& event : events) {
      if (record(session_.on_event(event), describe(event), frame_count_ > 0 ? &last_ : nullptr))
        return true;
    }
  }
  return false;
}

const std::vector<ScriptStep>& ScriptedHost::run(std::int64_t max_frames,
                                                 const std::stop_token& stop) {
  TARSIER_REQUIRE(max_frames >= 0, "at most {} frames", max_frames);
  constexpr std::chrono::milliseconds kTimeout(500);
  std::int64_t count = 0;
  while (!stop.stop_requested() && (max_frames == 0 || count < max_frames)) {
    if (send_events(frame_count_)) return steps_;
    std::optional<Frame> frame = source_.next(kTimeout, stop);
    if (!frame) {
      if (source_.ended()) {
        (void)send_events(std::numeric_limits<std::int64_t>::max());
        return steps_;
      }
      if (!stop.stop_requested() && record(session_.on_idle(source_.status()), "idle", nullptr))
        return steps_;
      continue;
    }
    ++count;
    ++frame_count_;
    last_ = std::move(*frame);
    if (record(session_.on_frame(last_, source_.status()), "frame", &last_)) return steps_;
  }
  return steps_;
}

std::string ScriptedHost::transcript() const {
  std::string text;
  for (const ScriptStep& step : steps_) {
    const nlohmann::json line = {{"frame", step.frame},
                                 {"cause", step.cause},
                                 {"status", step.status},
                                 {"state", step.state}};
    text += line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
  }
  return text;
}

}  // namespace tarsier
