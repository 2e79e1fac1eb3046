// SPDX-License-Identifier: MIT
// Input of running sessions: the journal of an annotation, actions and events from a pipe.
#include "tarsier/media/image_file.h"

#include "fuzz.h"
#include "ui/action_reader.h"
#include "ui/face/annotate_state.h"
#include "ui/window_lines.h"
#include <algorithm>
#include <cmath>
#include <fcntl.h>
#include <nlohmann/json.hpp>
#include <unistd.h>

namespace tarsier::fuzz {

TARSIER_FUZZ_TARGET(annotate_journal, kJson) {
  const std::string path = file_of(input, "set.json.journal");
  AnnotateState state;
  {
    AnnotateJournal journal(path);
    state.replay(journal.open(), path);
    (void)state.finished();
    journal.restart(state.difference(AnnotateState(), "all of it"));
  }
  // The next run reads what one run leaves, and gets the same.
  AnnotateState again;
  AnnotateJournal journal(path);
  again.replay(journal.open(), path);
  expect(again.difference(AnnotateState(), "") == state.difference(AnnotateState(), ""),
         "a journal of everything does not bring everything back");
}

TARSIER_FUZZ_TARGET(actions, kBytes) {
  const std::string path = file_of(input, "actions");
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  expect(fd >= 0, "cannot open the actions");
  ActionReader reader(fd, {{"sketch", "pencil sketch", 's'}, {"next", "", 0}},
                      {{"threshold", 0, 100, 1, 50}});
  while (!reader.ended()) {
    for (const Event& event : reader.read()) {
      const bool is_action = event.name == "sketch" || event.name == "next";
      const bool is_slider = event.name == "threshold" && event.value >= 0 && event.value <= 100;
      expect(event.kind == Event::Kind::kSlider ? is_slider : is_action, "an event of no action");
    }
  }
  ::close(fd);
}

TARSIER_FUZZ_TARGET(window_lines, kBytes) {
  WindowLines whole;
  const std::vector<WindowLine> at_once = whole.feed(text_of(input));
  for (const WindowLine& line : at_once) {
    const bool is_known = line.event || line.want || line.quality || line.max_width || line.close;
    // {"close":false} has no effect.
    if (!is_known) continue;
    expect(!line.quality || (*line.quality >= 1 && *line.quality <= 100),
           "a quality beyond 1..100");
    expect(!line.max_width || *line.max_width == 0 ||
               (*line.max_width >= 16 && *line.max_width <= 16384),
           "a width beyond its limits");
    if (!line.event) continue;
    const Event& event = *line.event;
    expect(std::isfinite(event.x) && std::isfinite(event.y) && std::isfinite(event.value),
           "a number that is none");
    expect(std::abs(event.x) <= 1e6 && std::abs(event.y) <= 1e6, "a mouse that is too far away");
    expect(std::abs(event.wheel) <= 100, "a wheel that turned too far");
    expect(event.kind != Event::Kind::kKey || event.key > 0, "a key that is none");
    const bool has_name = event.kind == Event::Kind::kAction || event.kind == Event::Kind::kSlider;
    expect(event.name.empty() != has_name && event.name.size() <= 200,
           "a name too many or too few");
  }
  WindowLines parts;
  std::size_t count = 0;
  Pieces pieces(input, 64);
  for (Bytes piece = pieces.next(); !piece.empty(); piece = pieces.next()) {
    count += parts.feed(text_of(piece)).size();
    expect(parts.held_bytes() <= 2 * WindowLines::kMaxLineLength, "more than a line is held");
  }
  expect(count == at_once.size(), "pieces of other sizes give other lines");
  expect(parts.refused() == whole.refused() && parts.last_error() == whole.last_error(),
         "pieces of other sizes are refused otherwise");
}

}  // namespace tarsier::fuzz
