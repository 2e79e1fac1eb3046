// SPDX-License-Identifier: MIT
#include "tarsier/mqtt/outbox.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/archive.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

namespace tarsier::mqtt {
namespace {

// JSON represents numbers up to this exactly
constexpr std::int64_t kMaxSeq = std::int64_t{1} << 53;

// 'TOB1'
const DatabaseKind kOutboxKind{"Tarsier outbox", 0x544F4231, {R"sql(
CREATE TABLE outbox(
  seq INTEGER PRIMARY KEY AUTOINCREMENT,
  payload TEXT NOT NULL         -- JSON
) STRICT;
CREATE TABLE outbox_id(id TEXT NOT NULL) STRICT;
INSERT INTO outbox_id VALUES(lower(hex(randomblob(8))));
)sql"}};

bool is_id(const std::string& text) {
  return text.size() == 16 && std::all_of(text.begin(), text.end(), [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
         });
}

// A member that is an integer in 0..kMaxSeq.
std::optional<std::int64_t> number_in(const nlohmann::ordered_json& object, const char* name) {
  const auto at = object.find(name);
  if (at == object.end() || !at->is_number_integer()) return std::nullopt;
  if (at->is_number_unsigned() && at->get<std::uint64_t>() > static_cast<std::uint64_t>(kMaxSeq))
    return std::nullopt;
  const auto value = at->get<std::int64_t>();
  if (value < 0 || value > kMaxSeq) return std::nullopt;
  return value;
}

std::optional<nlohmann::ordered_json> object_of(const std::string& text) {
  try {
    (void)parse_json(text, "message", {1'000'000, 16, 200'000});  // checks the limits
    nlohmann::ordered_json object = nlohmann::ordered_json::parse(text, nullptr, false);
    if (!object.is_object()) return std::nullopt;
    const auto id = object.find("outbox");
    if (id == object.end() || !id->is_string() || !is_id(id->get<std::string>()))
      return std::nullopt;
    return object;
  } catch (const Error&) {
    return std::nullopt;
  }
}

}  // namespace

Outbox::Outbox(const std::string& path) : database_(path, kOutboxKind, DatabaseAccess::kCreate) {
  Statement row(database_, "SELECT id FROM outbox_id");
  if (row.step()) id_ = row.text(0);
  if (!is_id(id_)) throw OutputError(path, "has no id: move it away, and a new one is made");
}

std::int64_t Outbox::add(std::string_view payload, std::int64_t max_entries) {
  Transaction transaction(database_);
  Statement(database_, "INSERT INTO outbox(payload) VALUES(?)").bind(1, payload).step();
  const std::int64_t seq = database_.last_row_id();
  Statement(database_, "DELETE FROM outbox WHERE seq <= ?").bind(1, seq - max_entries).step();
  transaction.commit();
  return seq;
}

void Outbox::read(
    std::int64_t number,
    const std::function<bool(std::int64_t number, const std::string& payload)>& take) {
  Statement rows(database_, "SELECT seq, payload FROM outbox WHERE seq > ? ORDER BY seq");
  rows.bind(1, number);
  while (rows.step()) {
    if (!take(rows.integer(0), rows.text(1))) break;
  }
}

std::int64_t Outbox::forget(std::int64_t number) {
  Statement(database_, "DELETE FROM outbox WHERE seq <= ?").bind(1, number).step();
  return database_.changed_rows();
}

std::int64_t Outbox::first() {
  Statement row(database_, "SELECT min(seq) FROM outbox");
  if (row.step() && !row.is_null(0)) return row.integer(0);
  return last() + 1;
}

std::int64_t Outbox::last() {
  Statement row(database_, "SELECT seq FROM sqlite_sequence WHERE name = 'outbox'");
  return row.step() ? row.integer(0) : 0;
}

std::int64_t Outbox::count() {
  Statement row(database_, "SELECT count(*) FROM outbox");
  return row.step() ? row.integer(0) : 0;
}

std::string event_message_text(const EventMessage& message) {
  // The event is JSON already.
  return fmt::format(R"({{"outbox":"{}","seq":{},"oldest":{},"event":{}}})", message.outbox,
                     message.seq, message.oldest, message.event);
}

std::optional<EventMessage> parse_event_message(const std::string& text) {
  const auto object = object_of(text);
  if (!object) return std::nullopt;
  const auto seq = number_in(*object, "seq");
  const auto oldest = number_in(*object, "oldest");
  const auto event = object->find("event");
  if (!seq || !oldest || *seq < 1 || *oldest < 1 || *oldest > *seq || event == object->end() ||
      !event->is_object())
    return std::nullopt;
  return EventMessage{
      object->at("outbox"), *seq, *oldest,
      event->dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace)};
}

std::string mark_text(const Mark& mark) {
  return fmt::format(R"({{"outbox":"{}","seq":{}}})", mark.outbox, mark.seq);
}

std::optional<Mark> parse_mark(const std::string& text) {
  const auto object = object_of(text);
  if (!object) return std::nullopt;
  const auto seq = number_in(*object, "seq");
  if (!seq) return std::nullopt;
  return Mark{object->at("outbox"), *seq};
}

}  // namespace tarsier::mqtt
