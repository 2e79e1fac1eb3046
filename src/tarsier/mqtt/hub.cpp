// SPDX-License-Identifier: MIT
#include "tarsier/mqtt/hub.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/mqtt/connection.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <set>
#include <utility>

namespace tarsier::mqtt {
namespace {

// 'THB1'
const DatabaseKind kKind{"Tarsier hub log", 0x54484231, {R"sql(
CREATE TABLE hub_event(
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  node TEXT NOT NULL,
  outbox TEXT NOT NULL,
  seq INTEGER NOT NULL,
  received INTEGER NOT NULL,    -- ms since 1970-01-01, UTC
  event TEXT NOT NULL,          -- JSON
  UNIQUE(node, outbox, seq)
) STRICT;
CREATE TABLE hub_mark(
  node TEXT NOT NULL,
  outbox TEXT NOT NULL,
  seq INTEGER NOT NULL,         -- all up to this one are stored, or will never come
  updated INTEGER NOT NULL,     -- counts up
  PRIMARY KEY(node, outbox)
) STRICT;
CREATE TABLE hub_id(id TEXT NOT NULL) STRICT;
INSERT INTO hub_id VALUES(lower(hex(randomblob(8))));
)sql"}};

constexpr std::size_t kMaxTogether = 500;  // messages of a transaction

std::int64_t now_ms() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace

HubLog::HubLog(const std::string& path, DatabaseAccess access) : database_(path, kKind, access) {
  Statement row(database_, "SELECT id FROM hub_id");
  if (row.step()) id_ = row.text(0);
}

std::vector<bool> HubLog::store(const std::vector<Received>& received, std::int64_t now) {
  std::vector<bool> is_new;
  std::set<std::pair<std::string, std::string>> boxes;
  Transaction together(database_);
  for (const auto& [node, message] : received) {
    Statement add(database_,
                  "INSERT OR IGNORE INTO hub_event(node, outbox, seq, received, event) VALUES(?, "
                  "?, ?, ?, ?)");
    add.bind(1, std::string_view(node))
        .bind(2, std::string_view(message.outbox))
        .bind(3, message.seq)
        .bind(4, now)
        .bind(5, std::string_view(message.event))
        .step();
    is_new.push_back(database_.changed_rows() > 0);
    Statement(database_,
              "INSERT INTO hub_mark(node, outbox, seq, updated) VALUES(?1, ?2, ?3, (SELECT "
              "coalesce(max(updated), 0) + 1 FROM hub_mark)) ON CONFLICT(node, outbox) DO UPDATE "
              "SET seq = max(seq, excluded.seq), updated = excluded.updated")
        .bind(1, std::string_view(node))
        .bind(2, std::string_view(message.outbox))
        .bind(3, message.oldest - 1)
        .step();
    boxes.emplace(node, message.outbox);
  }
  for (const auto& [node, outbox] : boxes) {
    std::int64_t seq = mark(node, outbox);
    const std::int64_t before = seq;
    Statement next(database_,
                   "SELECT seq FROM hub_event WHERE node = ? AND outbox = ? AND seq > ? ORDER BY "
                   "seq");
    next.bind(1, std::string_view(node)).bind(2, std::string_view(outbox)).bind(3, seq);
    while (next.step() && next.integer(0) == seq + 1) ++seq;
    if (seq == before) continue;
    Statement(database_, "UPDATE hub_mark SET seq = ?3 WHERE node = ?1 AND outbox = ?2")
        .bind(1, std::string_view(node))
        .bind(2, std::string_view(outbox))
        .bind(3, seq)
        .step();
  }
  together.commit();
  return is_new;
}

std::int64_t HubLog::mark(const std::string& node, const std::string& outbox) {
  Statement row(database_, "SELECT seq FROM hub_mark WHERE node = ? AND outbox = ?");
  row.bind(1, std::string_view(node)).bind(2, std::string_view(outbox));
  return row.step() ? row.integer(0) : 0;
}

std::vector<std::pair<std::string, Mark>> HubLog::marks() {
  std::vector<std::pair<std::string, Mark>> marks;
  Statement rows(database_,
                 "SELECT node, outbox, seq FROM hub_mark m WHERE updated = (SELECT max(updated) "
                 "FROM hub_mark WHERE node = m.node) ORDER BY node");
  while (rows.step()) marks.push_back({rows.text(0), {rows.text(1), rows.integer(2)}});
  return marks;
}

std::int64_t HubLog::count() {
  Statement row(database_, "SELECT count(*) FROM hub_event");
  return row.step() ? row.integer(0) : 0;
}

void HubLog::read(
    const std::function<bool(const std::string& node, const std::string& event)>& take) {
  Statement rows(database_, "SELECT node, event FROM hub_event ORDER BY id");
  while (rows.step()) {
    if (!take(rows.text(0), rows.text(1))) break;
  }
}

std::string node_of(const std::string& topic, const std::string& above) {
  constexpr std::string_view kEnd = "/events";
  if (!topic.starts_with(above + '/') || !topic.ends_with(kEnd) ||
      topic.size() <= above.size() + 1 + kEnd.size())
    return {};
  std::string node = topic.substr(above.size() + 1, topic.size() - above.size() - 1 - kEnd.size());
  return is_node_name(node) ? node : std::string();
}

void run_hub(HubLog& log, const HubOptions& options, const std::stop_token& stop) {
  sigset_t pipe;
  sigemptyset(&pipe);
  sigaddset(&pipe, SIGPIPE);
  ::pthread_sigmask(SIG_BLOCK, &pipe, nullptr);
  const std::string& above = options.address.topic;
  ConnectionOptions wanted;
  wanted.address = options.address;
  wanted.login = options.login;
  wanted.client = "tarsier-hub-" + log.id().substr(0, 8);
  wanted.keeps_session = true;
  std::chrono::milliseconds retry{500};
  bool warned = false;
  bool strange = false;
  while (!stop.stop_requested()) {
    Connection connection(wanted);
    if (connection.open(stop)) {
      log_info("{}: stores the events of {}/+", address_text(options.address), above);
      warned = false;
      retry = std::chrono::milliseconds(500);
      connection.subscribe(above + "/+/events");
      for (const auto& [node, mark] : log.marks())
        connection.publish(above + '/' + node + "/acked", mark_text(mark), true);
      while (connection.is_open() && !stop.stop_requested()) {
        connection.step(200);
        // One transaction for all that is there.
        std::vector<Message> messages = connection.take_messages();
        for (std::size_t before = 0; messages.size() > before && messages.size() < kMaxTogether;) {
          before = messages.size();
          connection.step(0);
          for (Message& message : connection.take_messages())
            messages.push_back(std::move(message));
        }
        std::vector<HubLog::Received> received;
        for (const Message& message : messages) {
          const std::string node = node_of(message.topic, above);
          auto event = parse_event_message(message.payload);
          if (node.empty() || !event) {
            if (!std::exchange(strange, true))
              log_warning("{}: no event of a node, passed over", printable(message.topic));
            continue;
          }
          received.push_back({node, std::move(*event)});
        }
        (void)connection.take_acknowledged();
        if (received.empty()) continue;
        const std::vector<bool> is_new = log.store(received, now_ms());
        std::set<std::pair<std::string, std::string>> boxes;
        for (std::size_t k = 0; k < received.size(); ++k) {
          boxes.emplace(received[k].node, received[k].message.outbox);
          if (is_new[k] && options.take) options.take(received[k].node, received[k].message.event);
        }
        for (const auto& [node, outbox] : boxes) {
          connection.publish(above + '/' + node + "/acked",
                             mark_text({outbox, log.mark(node, outbox)}), true);
        }
      }
      if (stop.stop_requested()) connection.close();
    }
    if (stop.stop_requested()) break;
    if (!std::exchange(warned, true)) {
      log_warning("{}: {}; waiting for it", address_text(options.address), connection.problem());
    }
    (void)sleep_unless_stopped(retry, stop);
    retry = std::min(2 * retry, std::chrono::milliseconds(10'000));
  }
}

}  // namespace tarsier::mqtt
