// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/sqlite.h"
#include "tarsier/mqtt/outbox.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace tarsier::mqtt {

// The events of all nodes, in an SQLite file or a PostgreSQL database. Each event is stored once,
// however often it arrives. Use one object per thread.
class HubLog {
 public:
  virtual ~HubLog() = default;
  HubLog(const HubLog&) = delete;
  HubLog& operator=(const HubLog&) = delete;

  // Unique id of this log: 16 hexadecimal digits.
  [[nodiscard]] const std::string& id() const { return id_; }

  // Stores several messages together; they are on the disk when it returns. Returns for each
  // whether it was new.
  struct Received {
    std::string node;
    EventMessage message;
  };
  std::vector<bool> store(const std::vector<Received>& received, std::int64_t now_ms);

  // The number up to which all events of a node's outbox are stored without a gap.
  [[nodiscard]] virtual std::int64_t mark(const std::string& node, const std::string& outbox) = 0;
  // The latest mark of each node.
  [[nodiscard]] virtual std::vector<std::pair<std::string, Mark>> marks() = 0;

  [[nodiscard]] virtual std::int64_t count() = 0;
  // Calls take() with node and JSON of each event in the order of arrival, until it returns false.
  virtual void read(
      const std::function<bool(const std::string& node, const std::string& event)>& take) = 0;

 protected:
  HubLog() = default;

  // Does all of `work` or nothing. It may run `work` a second time if the connection was lost.
  virtual void in_transaction(const std::function<void()>& work) = 0;
  // Returns false if the event was stored already.
  virtual bool add(const Received& received, std::int64_t now_ms) = 0;
  // Raises the mark to at least `seq` and makes it the latest of its node.
  virtual void raise_mark(const std::string& node, const std::string& outbox, std::int64_t seq) = 0;
  // The numbers of the events after `seq`, ascending, until take() returns false.
  virtual void numbers_after(const std::string& node, const std::string& outbox, std::int64_t seq,
                             const std::function<bool(std::int64_t)>& take) = 0;

  std::string id_;
};

// `where` is a file, or postgresql://[USER[:PASSWORD]@]HOST[:PORT]/DATABASE[?sslmode=..], which
// libpq interprets (environment, password file, TLS). Creates or upgrades the tables if `access`
// allows it. Throws as media/sqlite.h says, and Error if libpq is missing.
[[nodiscard]] std::unique_ptr<HubLog> open_hub_log(const std::string& where,
                                                   DatabaseAccess access = DatabaseAccess::kCreate);

// Whether `where` names a PostgreSQL database.
[[nodiscard]] bool is_postgres(std::string_view where);

}  // namespace tarsier::mqtt
