// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/sqlite.h"

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

namespace tarsier::mqtt {

// What a node has to say and nobody has stored yet: an SQLite file of its own, so that neither a
// kill nor a power cut nor a broker without memory loses an event. Entries are numbered 1, 2, ..
// and never again. One object a thread; several programs may use one file.
class Outbox {
 public:
  // Throws as media/sqlite.h says.
  explicit Outbox(const std::string& path);

  // Of this file and no other: 16 hexadecimal digits.
  [[nodiscard]] const std::string& id() const { return id_; }

  // On the disk when it returns. Returns its number. Where there are more than `max_entries`
  // afterwards, the oldest are dropped.
  std::int64_t add(std::string_view payload, std::int64_t max_entries);

  // Calls take() with number and payload of what lies behind `number`, until it returns false.
  void read(std::int64_t number,
            const std::function<bool(std::int64_t number, const std::string& payload)>& take);

  // Deletes up to that number, which itself was given by add() before. Returns how many.
  std::int64_t forget(std::int64_t number);

  [[nodiscard]] std::int64_t first();  // the lowest number that is there; last() + 1 where none is
  [[nodiscard]] std::int64_t last();   // the highest that was ever given; 0 at the beginning
  [[nodiscard]] std::int64_t count();

 private:
  Database database_;
  std::string id_;
};

// One event on its way to a hub: {"outbox","seq","oldest","event"}. `oldest` is the lowest number
// that the node still has: what lies below needs no waiting for.
struct EventMessage {
  std::string outbox;
  std::int64_t seq = 0;
  std::int64_t oldest = 0;
  std::string event;  // a JSON object
};
[[nodiscard]] std::string event_message_text(const EventMessage& message);
// Nothing for what is no such message.
[[nodiscard]] std::optional<EventMessage> parse_event_message(const std::string& text);

// How far a hub has stored a node's events without a gap: {"outbox","seq"}.
struct Mark {
  std::string outbox;
  std::int64_t seq = 0;
};
[[nodiscard]] std::string mark_text(const Mark& mark);
[[nodiscard]] std::optional<Mark> parse_mark(const std::string& text);

}  // namespace tarsier::mqtt
