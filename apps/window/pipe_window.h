// SPDX-License-Identifier: MIT
#pragma once

#include "window.h"
#include <memory>
#include <string_view>

namespace tarsier::window {

// A window whose place is somewhere else: in a browser, shown by the program that started this one
// (`tarsier serve`). It talks over two inherited descriptors, pipes or sockets, and is named by the
// environment: TARSIER_WINDOW=pipe:IN:OUT.
//
// From OUT come records: length of what follows (32 bits, big-endian), one byte of kind, payload.
//   H  JSON, first, and again when sliders or actions change:
//      {"title","actions":[{"name","help","key"}],"sliders":[{"name","low","high","step","value"}],
//       "stages": true where the session gives images of its stages}
//   S  JSON, after every frame and every event:
//      {"status","state":{..},"frame":{"index","time","name","age_ms","source","detail"}|null,
//       "sliders":{name:value},"finished","fullscreen","width","height","events"}
//      "width" and "height" are those of the images that are sent; 0 before the first. "source" is
//      "file", or the state of a live source. "events": how many events, and lines that
//      were passed over, the session has behind it.
//   J  an image: frame number and age in ms (32 bits each, big-endian; since the frame's last byte
//      came; 0 for files), then a JPEG
//   D  the stages of a frame: frame number, length of what follows (32 bits each), a JSON list
//      [{"name","width","height","bytes"}], and the JPEGs, one behind the other; at most 32 stages,
//      480 px wide and high
// Into IN go lines (ui/window_lines.h): events, {"want":1}, {"quality"},
// {"stages"}, {"max_width"}, {"close"}. Its end, and the end of OUT's reader, mean that the window was closed.
//
// An image is sent where one is wanted and newer than the last; each "want" is for one, and they do
// not add up. Without one nothing is encoded. "stages" is the same for the images of stages: a
// session makes none that nobody wants. The session never waits for a reader: one record is
// on its way, and of what waits behind it only the newest state and the newest image are kept.
// Action and slider names that were not offered, and lines that are broken or too long, are passed
// over with a warning once a second at most.

struct PipeEnds {
  int in = -1;
  int out = -1;
};
inline constexpr const char* kPipeVariable = "TARSIER_WINDOW";

// "pipe:3:4". Throws Error(kBadInput): of another form, or not two open descriptors.
[[nodiscard]] PipeEnds parse_pipe_ends(std::string_view text);

// Takes over both descriptors; they are closed with the window.
[[nodiscard]] std::unique_ptr<Window> make_pipe_window(const PipeEnds& ends,
                                                       const WindowOptions& options);

}  // namespace tarsier::window
