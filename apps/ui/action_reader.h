// SPDX-License-Identifier: MIT
#pragma once

#include "ui/session.h"
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

// Actions by name, one a line, from stdin or a pipe (`--actions -`), so that a script, a GPIO
// button or another program can drive a session:
//   sketch          does the action of that name
//   threshold 60    moves the slider of that name; beyond its ends it stops there
// Empty lines and lines that start with '#' are passed over. Unknown names, missing or broken
// numbers and lines of more than 200 bytes are logged as warnings and otherwise ignored.
class ActionReader {
 public:
  // `fd` is not owned, and stays open.
  ActionReader(int fd, std::vector<Action> actions, std::vector<Slider> sliders);

  // The events of the lines that are there by now, in their order. Never waits, starts no thread;
  // takes at most 4096 bytes at a time, so that no flood can hold up the frames.
  [[nodiscard]] std::vector<Event> read();

  // Nothing more can come: the other end is closed.
  [[nodiscard]] bool ended() const { return ended_; }

 private:
  void take_line(std::string_view line, std::vector<Event>& events) const;

  int fd_;
  std::vector<Action> actions_;
  std::vector<Slider> sliders_;
  std::string line_;       // the part that has come of the last line
  bool skipping_ = false;  // the rest of an overlong line
  bool ended_ = false;
};

}  // namespace tarsier
