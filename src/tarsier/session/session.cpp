// SPDX-License-Identifier: MIT
#include "tarsier/session/session.h"

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

}  // namespace tarsier
