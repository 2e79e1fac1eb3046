// SPDX-License-Identifier: MIT
#include "tarsier/session/frame_session.h"

#include "tarsier/image/draw/text.h"

#include <fmt/format.h>

#include <utility>

namespace tarsier {

View FrameSession::on_frame(const Frame& frame, const SourceStatus& source) {
  if (frame.still || frame.name != source_name_) restart();
  frame_ = frame.image;
  still_ = frame.still;
  source_name_ = frame.name;
  trouble_ = trouble_of(source);
  timer_.start();
  process(frame);
  timer_.stop();
  processed();
  return view(draw_again());
}

View FrameSession::on_idle(const SourceStatus& source) {
  if (idle()) draw_again();
  trouble_ = trouble_of(source);
  return view(false);
}

View FrameSession::on_event(const Event& event) {
  const std::string name = action_of(event, actions());
  const bool drawn = !controls_.act(name) && act(name) && draw_again();
  return view(drawn && still_);
}

std::vector<Action> FrameSession::actions() const { return controls_.after(own_actions()); }

bool FrameSession::draw_again() {
  if (frame_.empty()) return false;
  frame_.copyTo(output_);
  draw(output_);
  return true;
}

View FrameSession::view(bool fresh) {
  View result;
  result.state = state();
  result.state["paused"] = controls_.paused();
  result.status = fmt::format("{}{}{}", status(), trouble_.empty() ? "" : "  " + trouble_,
                              controls_.paused() ? "  paused" : "");
  if (fresh) result.output = output_;
  if (!output_.empty()) {
    output_.copyTo(shown_);
    image::draw::status_bar(shown_, result.status, timer_.words(still_) + "   h: help");
    if (controls_.help()) draw_help(shown_, title_, actions());
    result.image = shown_;
  }
  result.finished = controls_.finished();
  return result;
}

}  // namespace tarsier
