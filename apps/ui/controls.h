// SPDX-License-Identifier: MIT
#pragma once

#include "ui/session.h"
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

// The actions that every session has: "help", "quit" and, for sources that deliver frames by
// themselves, "pause".
class SessionControls {
 public:
  explicit SessionControls(bool pauses = false, int pause_key = key::kSpace)
      : pauses_(pauses), pause_key_(pause_key) {}
  // Performs the action of this name; false if it is not one of these.
  bool act(std::string_view name);
  // Returns `actions` followed by the common ones.
  [[nodiscard]] std::vector<Action> append_to(std::vector<Action> actions) const;
  [[nodiscard]] bool paused() const { return paused_; }
  [[nodiscard]] bool help() const { return help_; }
  [[nodiscard]] bool finished() const { return finished_; }

 private:
  bool pauses_;
  int pause_key_;
  bool paused_ = false;
  bool help_ = false;
  bool finished_ = false;
};

// "" for a source that is live, else its state: "stale", "connecting" ..
[[nodiscard]] std::string source_warning(const SourceStatus& source);

// "1 face", "2 faces".
[[nodiscard]] std::string count_text(std::size_t count, std::string_view one);

}  // namespace tarsier
