// SPDX-License-Identifier: MIT
#include "ui/controls.h"

#include <fmt/format.h>

namespace tarsier {

bool SessionControls::act(std::string_view name) {
  if (name == "quit") {
    finished_ = true;
  } else if (name == "help") {
    help_ = !help_;
  } else if (name == "pause" && pauses_) {
    paused_ = !paused_;
  } else {
    return false;
  }
  return true;
}

std::vector<Action> SessionControls::append_to(std::vector<Action> actions) const {
  if (pauses_) actions.push_back({"pause", "pause and resume", pause_key_});
  actions.push_back({"help", "show this list", 'h'});
  actions.push_back({"quit", "quit", 'q'});
  return actions;
}

std::string source_warning(const SourceStatus& source) {
  return source.state == SourceState::kLive ? "" : std::string(name_of(source.state));
}

std::string count_text(std::size_t count, std::string_view one) {
  return fmt::format("{} {}{}", count, one, count == 1 ? "" : "s");
}

}  // namespace tarsier
