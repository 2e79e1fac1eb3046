// SPDX-License-Identifier: MIT
#include "ui/session.h"

#include <algorithm>
#include <utility>

namespace tarsier {

Event key_event(int key) {
  Event event;
  event.kind = Event::Kind::kKey;
  event.key = key;
  return event;
}

Event action_event(std::string name) {
  Event event;
  event.kind = Event::Kind::kAction;
  event.name = std::move(name);
  return event;
}

Event slider_event(std::string name, double value) {
  Event event;
  event.kind = Event::Kind::kSlider;
  event.name = std::move(name);
  event.value = value;
  return event;
}

std::string action_of(const Event& event, const std::vector<Action>& actions) {
  if (event.kind == Event::Kind::kAction) return event.name;
  if (event.kind != Event::Kind::kKey || event.control || event.key == 0) return "";
  const auto of_key = [&](int key) {
    const auto action = std::find_if(actions.begin(), actions.end(),
                                     [&](const Action& each) { return each.key == key; });
    return action == actions.end() ? std::string() : action->name;
  };
  const auto if_there = [&](const char* name) {
    return std::any_of(actions.begin(), actions.end(),
                       [&](const Action& each) { return each.name == name; })
               ? std::string(name)
               : std::string();
  };
  int key = event.key;
  std::string name = of_key(key);
  if (!name.empty()) return name;
  if (key >= 'A' && key <= 'Z') key += 'a' - 'A';
  if (key == '=') key = '+';  // the same key without Shift
  if (key == '_') key = '-';
  name = of_key(key);
  if (!name.empty()) return name;
  switch (key) {
    case key::kEscape:
    case 'q':
      return if_there("quit");
    case 'h':
    case '?':
      return if_there("help");
    case key::kRight:
    case key::kSpace:
    case key::kEnter:
      return if_there("next");
    case key::kLeft:
      return if_there("previous");
    default:
      return "";
  }
}

}  // namespace tarsier
