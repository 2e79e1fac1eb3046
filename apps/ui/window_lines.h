// SPDX-License-Identifier: MIT
#pragma once

#include "ui/session.h"
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

// What a program that shows a session in its own place (a browser, say) asks of it, by one line: a
// JSON object with one or several of these members.
//   {"key":115,"shift":false,"control":false}        an ASCII code, or one of key::
//   {"mouse":"left-down","x":10,"y":20,"wheel":0,"shift":false,"control":false}
//       move, left-down, left-up, right-down, right-up, middle-down, middle-up, wheel, double;
//       pixels, centres at integers, of the image that was sent last (before the first: as large as
//       it would be sent), or with "width":640 of an image of that width
//       (px, 1..16384): sizes change on the way
//   {"action":"sketch"}   {"slider":"threshold","value":60}
//   {"want":1}                              one more image; 0: none
//   {"stages":1}                            the images of the stages of the next frame; 0: none
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

// Throws std::invalid_argument, in one line: no JSON object, none of the members above, or a value
// of another type or beyond its limits. Other members are passed over.
[[nodiscard]] WindowLine parse_window_line(std::string_view line);

// Cuts lines out of bytes that come in pieces of any size. Pure. Holds at most one line.
class WindowLines {
 public:
  static constexpr std::size_t kLongestLine = 64U << 10U;  // bytes

  // The lines that these bytes end. Empty ones are passed over; those that are broken or too long
  // are counted in refused().
  [[nodiscard]] std::vector<WindowLine> feed(std::string_view bytes);

  [[nodiscard]] std::size_t refused() const { return refused_; }
  // Why the last one was; empty: none was.
  [[nodiscard]] const std::string& trouble() const { return trouble_; }
  // Bytes held, for tests.
  [[nodiscard]] std::size_t held_bytes() const { return line_.capacity(); }

 private:
  void refuse(std::string trouble);

  std::string line_;       // the part that has come of the last line
  bool skipping_ = false;  // the rest of one that is too long
  std::size_t refused_ = 0;
  std::string trouble_;
};

}  // namespace tarsier
