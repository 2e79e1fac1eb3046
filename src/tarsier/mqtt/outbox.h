// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/sqlite.h"

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

namespace tarsier::mqtt {

// Events of a node that no hub has stored yet. They are in an SQLite file, so that a kill, a power
// cut or a broker without memory loses no event. Entries are numbered 1, 2, ..; no number is used
// twice. Use one object per thread; several programs may use one file.
class Outbox {
 public:
  // Throws as media/sqlite.h says.
  explicit Outbox(const std::string& path);

  // Unique id of this file: 16 hexadecimal digits.
  [[nodiscard]] const std::string& id() const { return id_; }

  // Adds an event, which is on the disk when it returns. Returns its number. If there are then more
  // than `max_entries`, the oldest are dropped.
  std::int64_t add(std::string_view payload, std::int64_t max_entries);

  // Calls take() with number and payload of each entry after `number`, until it returns false.
  void read(std::int64_t number,
            const std::function<bool(std::int64_t number, const std::string& payload)>& take);

  // Deletes the entries up to `number`, which add() must have returned before. Returns how many.
  std::int64_t forget(std::int64_t number);

  [[nodiscard]] std::int64_t first();  // the lowest existing number; last() + 1 if there is none
  [[nodiscard]] std::int64_t last();   // the highest number ever assigned; 0 at the beginning
  [[nodiscard]] std::int64_t count();

 private:
  Database database_;
  std::string id_;
};

// One event on its way to a hub: {"outbox","seq","oldest","event"}. `oldest` is the lowest number
// that the node still has; a hub need not wait for lower ones.
struct EventMessage {
  std::string outbox;
  std::int64_t seq = 0;
  std::int64_t oldest = 0;
  std::string event;  // a JSON object
};
[[nodiscard]] std::string event_message_text(const EventMessage& message);
// nullopt if the text is not such a message.
[[nodiscard]] std::optional<EventMessage> parse_event_message(const std::string& text);

// The number up to which a hub has stored a node's events without a gap: {"outbox","seq"}.
struct Mark {
  std::string outbox;
  std::int64_t seq = 0;
};
[[nodiscard]] std::string mark_text(const Mark& mark);
[[nodiscard]] std::optional<Mark> parse_mark(const std::string& text);

}  // namespace tarsier::mqtt
