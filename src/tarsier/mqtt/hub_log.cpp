// SPDX-License-Identifier: MIT
#include "tarsier/mqtt/hub_log.h"

#include "tarsier/mqtt/hub_postgres.h"

#include <set>

namespace tarsier::mqtt {
namespace {

// 'THB1'
const DatabaseKind kHubLogKind{"Tarsier hub log", 0x54484231, {R"sql(
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

class SqliteHubLog final : public HubLog {
 public:
  SqliteHubLog(const std::string& path, DatabaseAccess access)
      : database_(path, kHubLogKind, access) {
    Statement row(database_, "SELECT id FROM hub_id");
    if (row.step()) id_ = row.text(0);
  }

  std::int64_t mark(const std::string& node, const std::string& outbox) override {
    Statement row(database_, "SELECT seq FROM hub_mark WHERE node = ? AND outbox = ?");
    row.bind(1, std::string_view(node)).bind(2, std::string_view(outbox));
    return row.step() ? row.integer(0) : 0;
  }

  std::vector<std::pair<std::string, Mark>> marks() override {
    std::vector<std::pair<std::string, Mark>> marks;
    Statement rows(database_,
                   "SELECT node, outbox, seq FROM hub_mark m WHERE updated = (SELECT max(updated) "
                   "FROM hub_mark WHERE node = m.node) ORDER BY node");
    while (rows.step()) marks.push_back({rows.text(0), {rows.text(1), rows.integer(2)}});
    return marks;
  }

  std::int64_t count() override {
    Statement row(database_, "SELECT count(*) FROM hub_event");
    return row.step() ? row.integer(0) : 0;
  }

  void read(
      const std::function<bool(const std::string& node, const std::string& event)>& take) override {
    Statement rows(database_, "SELECT node, event FROM hub_event ORDER BY id");
    while (rows.step()) {
      if (!take(rows.text(0), rows.text(1))) break;
    }
  }

 private:
  void in_transaction(const std::function<void()>& work) override {
    Transaction transaction(database_);
    work();
    transaction.commit();
  }

  bool add(const Received& received, std::int64_t now_ms) override {
    const auto& [node, message] = received;
    Statement(database_,
              "INSERT OR IGNORE INTO hub_event(node, outbox, seq, received, event) VALUES(?, ?, ?, "
              "?, ?)")
        .bind(1, std::string_view(node))
        .bind(2, std::string_view(message.outbox))
        .bind(3, message.seq)
        .bind(4, now_ms)
        .bind(5, std::string_view(message.event))
        .step();
    return database_.changed_rows() > 0;
  }

  void raise_mark(const std::string& node, const std::string& outbox, std::int64_t seq) override {
    Statement(database_,
              "INSERT INTO hub_mark(node, outbox, seq, updated) VALUES(?1, ?2, ?3, (SELECT "
              "coalesce(max(updated), 0) + 1 FROM hub_mark)) ON CONFLICT(node, outbox) DO UPDATE "
              "SET seq = max(seq, excluded.seq), updated = excluded.updated")
        .bind(1, std::string_view(node))
        .bind(2, std::string_view(outbox))
        .bind(3, seq)
        .step();
  }

  void numbers_after(const std::string& node, const std::string& outbox, std::int64_t seq,
                     const std::function<bool(std::int64_t)>& take) override {
    Statement rows(database_,
                   "SELECT seq FROM hub_event WHERE node = ? AND outbox = ? AND seq > ? ORDER BY "
                   "seq");
    rows.bind(1, std::string_view(node)).bind(2, std::string_view(outbox)).bind(3, seq);
    while (rows.step()) {
      if (!take(rows.integer(0))) break;
    }
  }

  Database database_;
};

}  // namespace

std::vector<bool> HubLog::store(const std::vector<Received>& received, std::int64_t now_ms) {
  std::vector<bool> is_new;
  in_transaction([&] {
    is_new.clear();
    std::set<std::pair<std::string, std::string>> outboxes;
    for (const Received& one : received) {
      is_new.push_back(add(one, now_ms));
      raise_mark(one.node, one.message.outbox, one.message.oldest - 1);
      outboxes.emplace(one.node, one.message.outbox);
    }
    for (const auto& [node, outbox] : outboxes) {
      const std::int64_t before = mark(node, outbox);
      std::int64_t seq = before;
      numbers_after(node, outbox, before, [&](std::int64_t number) {
        if (number != seq + 1) return false;
        seq = number;
        return true;
      });
      if (seq > before) raise_mark(node, outbox, seq);
    }
  });
  return is_new;
}

bool is_postgres(std::string_view where) {
  return where.starts_with("postgresql://") || where.starts_with("postgres://");
}

std::unique_ptr<HubLog> open_hub_log(const std::string& where, DatabaseAccess access) {
  if (is_postgres(where)) return open_postgres_hub_log(where, access);
  return std::make_unique<SqliteHubLog>(where, access);
}

}  // namespace tarsier::mqtt
