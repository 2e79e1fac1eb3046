// SPDX-License-Identifier: MIT
#pragma once

#include "ui/session.h"
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

// What a person can do in every session: "help", "quit" and, where frames come by themselves,
// "pause".
class SessionControls {
 public:
  explicit SessionControls(bool pauses = false, int pause_key = key::kSpace)
      : pauses_(pauses), pause_key_(pause_key) {}
  // Does the action of this name; false where it is none of these.
  bool act(std::string_view name);
  // `actions` and behind them these.
  [[nodiscard]] std::vector<Action> after(std::vector<Action> actions) const;
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

// "" of a live source, else what it is: "stalled", "connecting" ..
[[nodiscard]] std::string trouble_of(const SourceStatus& source);

// "1 face", "2 faces".
[[nodiscard]] std::string counted(std::size_t count, std::string_view one);

}  // namespace tarsier
