// SPDX-License-Identifier: MIT
#pragma once

#include "ui/session.h"
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

// Reads actions by name, one per line, from stdin or a pipe (`--actions -`). A script, a GPIO
// button or another program can thus control a session:
//   sketch          performs the action of that name
//   threshold 60    moves the slider of that name; the value is clamped to its limits
// Empty lines and lines that start with '#' are skipped. Unknown names, missing or malformed
// numbers and lines of more than 200 bytes are logged as warnings and ignored.
class ActionReader {
 public:
  // `fd` is not owned, and stays open.
  ActionReader(int fd, std::vector<Action> actions, std::vector<Slider> sliders);

  // The events of the lines that have arrived, in their order. It does not wait and starts no
  // thread. It reads at most 4096 bytes per call, so that a flood of lines cannot delay the frames.
  [[nodiscard]] std::vector<Event> read();

  // No more lines can arrive: the other end is closed.
  [[nodiscard]] bool ended() const { return ended_; }

 private:
  void take_line(std::string_view line, std::vector<Event>& events) const;

  int fd_;
  std::vector<Action> actions_;
  std::vector<Slider> sliders_;
  std::string line_;       // the received part of the last line
  bool skipping_ = false;  // skips the rest of an overlong line
  bool ended_ = false;
};

}  // namespace tarsier
