// SPDX-License-Identifier: MIT
#pragma once

#include "window.h"
#include <memory>
#include <string_view>

namespace tarsier::window {

// A window that is shown elsewhere: in a browser, by the program that started this one (`tarsier
// serve`). It communicates over two inherited descriptors, pipes or sockets, which the environment
// names: TARSIER_WINDOW=pipe:IN:OUT.
//
// Records are written to OUT: length of the rest (32 bits, big-endian), one byte of kind, payload.
//   H  JSON, first, and again if sliders or actions change:
//      {"title","actions":[{"name","help","key"}],"sliders":[{"name","low","high","step","value"}],
//       "stages": true if the session has stage images}
//   S  JSON, after every frame and every event:
//      {"status","state":{..},"frame":{"index","time","name","age_ms","source","detail"}|null,
//       "sliders":{name:value},"finished","fullscreen","width","height","events"}
//      "width" and "height" are the size of the sent images; 0 before the first. "source" is
//      "file", or the state of a live source. "events": number of events and skipped lines that the
//      session has processed.
//   J  an image: frame number and age in ms (32 bits each, big-endian; the age counts from the
//      arrival of the frame's last byte; 0 for files), then a JPEG
//   D  the stages of a frame: frame number, length of the rest (32 bits each), a JSON list
//      [{"name","width","height","bytes"}], then the JPEGs; at most 32 stages, 480 px wide and high
// Lines are read from IN (ui/window_lines.h): events, {"want":1}, {"quality"}, {"stages"},
// {"max_width"}, {"close"}. The end of IN, or of OUT's reader, means that the window was closed.
//
// An image is sent if one was requested and there is a newer one. Each "want" requests one image;
// requests do not add up. Without a request nothing is encoded. "stages" requests stage images in
// the same way; a session computes none without a request. The session never waits for a reader:
// while one record is being sent, only the newest state and the newest image are kept for later.
// Unknown action and slider names, and malformed or overlong lines, are skipped with a warning at
// most once a second.

struct PipeEnds {
  int in = -1;
  int out = -1;
};
inline constexpr const char* kPipeVariable = "TARSIER_WINDOW";

// Parses "pipe:3:4". Throws Error(ErrorKind::kInput) for another form or if they are not two open
// descriptors.
[[nodiscard]] PipeEnds parse_pipe_ends(std::string_view text);

// Takes ownership of both descriptors; they are closed with the window.
[[nodiscard]] std::unique_ptr<Window> make_pipe_window(const PipeEnds& ends,
                                                       const WindowOptions& options);

}  // namespace tarsier::window
