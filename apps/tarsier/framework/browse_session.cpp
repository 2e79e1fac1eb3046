// SPDX-License-Identifier: MIT
#include "framework/browse_session.h"

#include "ui/scripted_host.h"
#include "window.h"
#include <memory>
#include <nlohmann/json.hpp>
#include <vector>

namespace tarsier::cli {

void print_event_line(const Event& event, const View& view) {
  const nlohmann::ordered_json line{{"event", describe(event)}, {"state", view.state}};
  print_json(line);
}

ExitStatus browse_session(Session& session, const std::string& title, bool fullscreen,
                          Context& context, const BetweenEvents& between) {
  session.draw_status(!window::shows_status());
  const std::unique_ptr<window::Window> window =
      window::open_window({title, fullscreen, session.sliders(), session.actions()});
  bool finished = false;
  {
    const View first = session.on_idle({});
    window->show(first, nullptr);
    finished = first.finished;
  }
  std::chrono::milliseconds wait(0);
  while (!finished && !context.stop.stop_requested()) {
    const std::vector<Event> events = window->poll(wait);
    if (window->closed()) break;
    std::optional<View> last;
    for (const Event& event : events) {
      last.reset();  // a view is valid until the next call
      last = session.on_event(event);
      const bool is_move = event.kind == Event::Kind::kMouse && event.mouse == Event::Mouse::kMove;
      if (context.json && !is_move) print_event_line(event, *last);
      finished = finished || last->finished;
      if (last->toggle_fullscreen) window->set_fullscreen(!window->fullscreen());
      if (event.kind == Event::Kind::kMouse) continue;
      window->set_controls(session.actions(), session.sliders());
    }
    if (finished) break;
    if (last) window->show(*last, nullptr);
    wait = std::chrono::milliseconds(50);
    if (!between) continue;
    last.reset();
    last = between(wait);
    if (!last) continue;
    finished = finished || last->finished;
    window->show(*last, nullptr);
  }
  return context.stop.stop_requested() ? ExitStatus::kInterrupted : ExitStatus::kDone;
}

}  // namespace tarsier::cli
