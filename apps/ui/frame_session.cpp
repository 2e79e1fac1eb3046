// SPDX-License-Identifier: MIT
#include "ui/frame_session.h"

#include "tarsier/image/draw/text.h"
#include "tarsier/media/still_source.h"

#include <fmt/format.h>

#include <utility>

namespace tarsier {

View FrameSession::on_frame(const Frame& frame, const SourceStatus& source) {
  set_source(source);
  if (controls_.paused() && !frame.still && !latest_.image.empty())
    return view(false);  // paused: a camera continues, the shown image stays
  if (frame.still || source_of(frame) != source_of(latest_)) restart();
  latest_ = frame;
  timer_.start();
  process(frame);
  timer_.stop();
  on_processed();
  return view(update_drawing());
}

View FrameSession::on_idle(const SourceStatus& source) {
  set_source(source);
  if (idle()) update_drawing();
  return view(false);
}

View FrameSession::on_event(const Event& event) {
  bool changed = false;
  if (event.kind == Event::Kind::kMouse) {
    changed = mouse(event);
  } else if (event.kind == Event::Kind::kSlider) {
    changed = slide(event);
  } else {
    const std::string name = action_of(event, actions());
    changed = !controls_.act(name) && act(name);
  }
  return view(changed && update_drawing() && still());
}

std::vector<Action> FrameSession::actions() const { return controls_.append_to(own_actions()); }

View FrameSession::redraw() { return view(update_drawing()); }

void FrameSession::set_source(const SourceStatus& source) {
  source_ = source;
  source_warning_ = source_warning(source);
}

bool FrameSession::update_drawing() {
  if (frame().empty()) return false;
  begin_drawing(output_);
  draw(output_);
  return true;
}

View FrameSession::view(bool fresh) {
  View result;
  result.state = state();
  result.state["paused"] = controls_.paused();
  result.status =
      fmt::format("{}{}{}", status(), source_warning_.empty() ? "" : "  " + source_warning_,
                  controls_.paused() ? "  paused" : "");
  if (fresh) result.output = output_;
  result.finished = controls_.finished();
  result.toggle_fullscreen = std::exchange(toggles_fullscreen_, false);
  if (!is_shown()) {
    result.image = output_;
    return result;
  }
  if (output_.empty()) {
    if (!draw_placeholder(shown_)) return result;
  } else {
    output_.copyTo(shown_);
    draw_shown(shown_);
  }
  const std::string said = message();
  if (!draws_status() && !said.empty()) result.status = said;
  if (draws_status()) {
    image::draw::status_bar(shown_, said.empty() ? result.status : said, note());
    if (controls_.help()) draw_help(shown_, title_, actions(), help_lines());
  }
  result.image = shown_;
  return result;
}

}  // namespace tarsier
