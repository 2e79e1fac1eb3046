// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/session/session.h"

#include <string>
#include <vector>

// What sessions that look through a list of things share. For the .cpp files of this module.
namespace tarsier {

// The action that an event means: a key of its own, else the arrows for "next" and "previous", and
// Escape for "quit". "": none.
inline std::string action_of(const Event& event, const std::vector<Action>& actions) {
  if (event.kind == Event::Kind::kAction) return event.name;
  if (event.kind != Event::Kind::kKey) return "";
  if (event.key == key::kEscape) return "quit";
  if (event.key == key::kRight || event.key == key::kSpace || event.key == key::kEnter) {
    for (const Action& action : actions)
      if (action.key == event.key) return action.name;
    return "next";
  }
  if (event.key == key::kLeft) return "previous";
  for (const Action& action : actions)
    if (action.key == event.key) return action.name;
  return "";
}

}  // namespace tarsier
