// SPDX-License-Identifier: MIT
#pragma once

#include "ui/session.h"
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

// The requests of a program that shows a session in its own interface (for example a browser). Each
// line is a JSON object with one or several of these members:
//   {"key":115,"shift":false,"control":false}        an ASCII code, or one of key::
//   {"mouse":"left-down","x":10,"y":20,"wheel":0,"shift":false,"control":false}
//       move, left-down, left-up, right-down, right-up, middle-down, middle-up, wheel, double. x
//       and
//       y are pixels, centres at integers, of the last image that was sent (before the first: of
//       the
//       size that it would have). With "width":640 they refer to an image of that width (px,
//       1..16384), because the size may change in transit.
//   {"action":"sketch"}   {"slider":"threshold","value":60}
//   {"want":1}                              requests one more image; 0: none
//   {"stages":1}                            requests the stage images of the next frame; 0: none
//   {"quality":80,"max_width":1280}         of images: JPEG 1..100; px 16..16384, 0: no limit
//   {"close":true}                          the user closed the window
struct WindowLine {
  std::optional<Event> event;
  std::optional<int> image_width;  // of a mouse event
  std::optional<bool> want;
  std::optional<bool> stages;
  std::optional<int> quality;
  std::optional<int> max_width;
  bool close = false;
};

// Throws std::invalid_argument, in one line: not a JSON object, none of the members above, or a
// value of another type or out of range. Other members are ignored.
[[nodiscard]] WindowLine parse_window_line(std::string_view line);

// Splits bytes that arrive in pieces of any size into lines. No I/O. Holds at most one line.
class WindowLines {
 public:
  static constexpr std::size_t kMaxLineLength = 64U << 10U;  // bytes

  // The lines that these bytes complete. Empty lines are skipped; malformed and overlong lines are
  // counted in refused().
  [[nodiscard]] std::vector<WindowLine> feed(std::string_view bytes);

  [[nodiscard]] std::size_t refused() const { return refused_; }
  // Why the last refused line was refused; empty if none was.
  [[nodiscard]] const std::string& last_error() const { return last_error_; }
  // Bytes of memory held; for tests.
  [[nodiscard]] std::size_t held_bytes() const { return line_.capacity(); }

 private:
  void refuse(std::string reason);

  std::string line_;       // the received part of the last line
  bool skipping_ = false;  // skips the rest of an overlong line
  std::size_t refused_ = 0;
  std::string last_error_;
};

}  // namespace tarsier
