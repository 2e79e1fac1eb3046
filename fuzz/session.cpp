// SPDX-License-Identifier: MIT
// What sessions read while they run: the journal of an annotation, actions from a pipe.
#include "tarsier/media/image_file.h"
#include "tarsier/session/action_reader.h"
#include "tarsier/session/annotate_state.h"

#include "fuzz.h"
#include <algorithm>
#include <fcntl.h>
#include <nlohmann/json.hpp>
#include <unistd.h>

namespace tarsier::fuzz {

TARSIER_FUZZ_TARGET(annotate_journal, kJson) {
  const std::string path = file_of(input, "set.json.journal");
  AnnotateState state;
  {
    AnnotateJournal journal(path);
    for (const nlohmann::json& record : journal.open()) state.apply(record, path);
    (void)state.finished();
    journal.restart(state.difference(AnnotateState(), "all of it"));
  }
  // What one run leaves, the next reads, and has the same.
  AnnotateState again;
  AnnotateJournal journal(path);
  for (const nlohmann::json& record : journal.open()) again.apply(record, path);
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

}  // namespace tarsier::fuzz
