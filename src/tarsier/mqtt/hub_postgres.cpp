// SPDX-License-Identifier: MIT
#include "tarsier/mqtt/hub_postgres.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/media/frame_source.h"

#include <fmt/format.h>

#include <charconv>
#include <chrono>
#include <dlfcn.h>
#include <functional>
#include <random>
#include <stdexcept>
#include <thread>
#include <utility>

namespace tarsier::mqtt {
namespace {

// libpq's interface as in its manual; the ABI of libpq.so.5 has not changed since 2006.
struct PgConnection;
struct PgResult;
constexpr int kConnectionOk = 0;
constexpr int kCommandOk = 1;
constexpr int kTuplesOk = 2;

// Its functions; never unloaded.
struct Library {
  PgConnection* (*connect)(const char*) = nullptr;
  int (*status)(const PgConnection*) = nullptr;
  char* (*error)(const PgConnection*) = nullptr;
  void (*reset)(PgConnection*) = nullptr;
  void (*finish)(PgConnection*) = nullptr;
  PgResult* (*run)(PgConnection*, const char*) = nullptr;
  PgResult* (*run_with_values)(PgConnection*, const char*, int, const unsigned*, const char* const*,
                               const int*, const int*, int) = nullptr;
  int (*result_status)(const PgResult*) = nullptr;
  char* (*result_error)(const PgResult*) = nullptr;
  int (*rows)(const PgResult*) = nullptr;
  char* (*value)(const PgResult*, int, int) = nullptr;
  char* (*changed)(PgResult*) = nullptr;
  void (*clear)(PgResult*) = nullptr;
  void (*(*on_notice)(PgConnection*, void (*)(void*, const char*), void*))(void*,
                                                                           const char*) = nullptr;
  int (*version)() = nullptr;
  std::string missing;  // why libpq cannot be used

  Library() {
    void* handle = ::dlopen("libpq.so.5", RTLD_NOW | RTLD_LOCAL);
    if (handle == nullptr) {
      missing = "libpq is not installed: sudo apt install libpq5";
      return;
    }
    find(handle, connect, "PQconnectdb");
    find(handle, status, "PQstatus");
    find(handle, error, "PQerrorMessage");
    find(handle, reset, "PQreset");
    find(handle, finish, "PQfinish");
    find(handle, run, "PQexec");
    find(handle, run_with_values, "PQexecParams");
    find(handle, result_status, "PQresultStatus");
    find(handle, result_error, "PQresultErrorMessage");
    find(handle, rows, "PQntuples");
    find(handle, value, "PQgetvalue");
    find(handle, changed, "PQcmdTuples");
    find(handle, clear, "PQclear");
    find(handle, on_notice, "PQsetNoticeProcessor");
    find(handle, version, "PQlibVersion");
  }

  template <class Function>
  void find(void* handle, Function& function, const char* name) {
    function = reinterpret_cast<Function>(::dlsym(handle, name));
    if (function == nullptr) missing = fmt::format("libpq lacks {}: install a newer one", name);
  }
};

const Library& library() {
  static const Library loaded;
  return loaded;
}

// One line from messages of libpq and of the server: "ERROR:  .." and a second line.
std::string one_line(std::string_view text) {
  std::string line;
  for (const char c : text) {
    const bool space = c == '\n' || c == '\t' || c == ' ';
    if (!space) line += c;
    if (space && !line.empty() && line.back() != ' ') line += ' ';
  }
  while (!line.empty() && line.back() == ' ') line.pop_back();
  return line;
}

// The connection was lost; the work may be retried.
struct ConnectionLost : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class Rows {
 public:
  explicit Rows(PgResult* result) : result_(result) {}
  ~Rows() { library().clear(result_); }
  Rows(const Rows&) = delete;
  Rows& operator=(const Rows&) = delete;

  [[nodiscard]] int count() const { return library().rows(result_); }
  [[nodiscard]] std::string text(int row, int column) const {
    return library().value(result_, row, column);
  }
  [[nodiscard]] std::int64_t integer(int row, int column) const {
    std::int64_t number = 0;
    const std::string_view text = library().value(result_, row, column);
    std::from_chars(text.data(), text.data() + text.size(), number);
    return number;
  }
  [[nodiscard]] bool changed() const { return std::string_view(library().changed(result_)) != "0"; }

 private:
  PgResult* result_;
};

class Server {
 public:
  Server(std::string address, bool writes) : address_(std::move(address)), writes_(writes) {
    if (!library().missing.empty())
      throw Error(ErrorKind::kInput, fmt::format("{}: {}", name(), library().missing));
    handle_ = library().connect(address_.c_str());
    if (!begin()) {
      const std::string reason = problem();
      library().finish(handle_);
      refuse(reason);
    }
  }
  ~Server() { library().finish(handle_); }
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  // Outside of in_transaction() it is retried after a lost connection, so use it only for queries.
  Rows run(const char* statement, const std::vector<std::string>& values = {}) {
    if (is_in_transaction_) return Rows(result_of(statement, values));
    PgResult* result = nullptr;
    with_reconnect([&] { result = result_of(statement, values); });
    return Rows(result);
  }

  // Does all of `work` or nothing; retries it after a lost connection.
  void in_transaction(const std::function<void()>& work) {
    is_in_transaction_ = true;
    try {
      with_reconnect([&] {
        run("BEGIN");
        work();
        run("COMMIT");
      });
    } catch (...) {
      is_in_transaction_ = false;
      library().clear(library().run(handle_, "ROLLBACK"));
      throw;
    }
    is_in_transaction_ = false;
  }

  [[noreturn]] void refuse(const std::string& reason) const {
    if (writes_) throw OutputError(name(), reason);
    throw InputError(name(), reason);
  }

 private:
  static constexpr std::chrono::seconds kReconnectTimeout{20};
  static constexpr std::chrono::milliseconds kRetry{500};

  [[nodiscard]] std::string name() const { return masked(address_); }
  [[nodiscard]] std::string problem() const { return one_line(library().error(handle_)); }

  PgResult* result_of(const char* statement, const std::vector<std::string>& values) {
    std::vector<const char*> texts;
    texts.reserve(values.size());
    for (const std::string& value : values) texts.push_back(value.c_str());
    PgResult* result = values.empty() ? library().run(handle_, statement)
                                      : library().run_with_values(
                                            handle_, statement, static_cast<int>(texts.size()),
                                            nullptr, texts.data(), nullptr, nullptr, 0);
    const int status = library().result_status(result);
    if (status == kCommandOk || status == kTuplesOk) return result;
    const std::string reason = one_line(library().result_error(result));
    library().clear(result);
    if (library().status(handle_) != kConnectionOk) throw ConnectionLost(reason);
    refuse(reason);
  }

  void with_reconnect(const std::function<void()>& work) {
    const auto until = std::chrono::steady_clock::now() + kReconnectTimeout;
    bool warned = false;
    while (true) {
      try {
        return work();
      } catch (const ConnectionLost& error) {
        if (std::chrono::steady_clock::now() > until) refuse(error.what());
        if (!std::exchange(warned, true))
          log_warning("{}: {}; waiting for it", name(), error.what());
        std::this_thread::sleep_for(kRetry);
        library().reset(handle_);
        (void)begin();
      }
    }
  }

  bool begin() {
    if (library().status(handle_) != kConnectionOk) return false;
    library().on_notice(
        handle_, [](void*, const char*) {}, nullptr);
    library().clear(library().run(
        handle_, writes_
                     ? "SET client_encoding TO 'UTF8'; SET synchronous_commit TO on"
                     : "SET client_encoding TO 'UTF8'; SET default_transaction_read_only TO on"));
    return true;
  }

  std::string address_;
  bool writes_;
  bool is_in_transaction_ = false;
  PgConnection* handle_ = nullptr;
};

// Element k has the statements that upgrade version k to k + 1: the tables of hub_log.cpp.
constexpr const char* kVersions[] = {R"sql(
CREATE TABLE hub_event(
  id BIGINT GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
  node TEXT NOT NULL,
  outbox TEXT NOT NULL,
  seq BIGINT NOT NULL,
  received BIGINT NOT NULL,     -- ms since 1970-01-01, UTC
  event TEXT NOT NULL,          -- JSON
  UNIQUE(node, outbox, seq)
);
CREATE TABLE hub_mark(
  node TEXT NOT NULL,
  outbox TEXT NOT NULL,
  seq BIGINT NOT NULL,          -- all up to this one are stored, or will never come
  updated BIGINT NOT NULL,      -- counts up
  PRIMARY KEY(node, outbox)
);
CREATE TABLE hub_id(id TEXT NOT NULL);
)sql"};
constexpr std::int64_t kNewest = std::size(kVersions);

std::string random_id() {
  std::random_device device;
  return fmt::format("{:08x}{:08x}", device(), device());
}

class PostgresHubLog final : public HubLog {
 public:
  PostgresHubLog(const std::string& address, DatabaseAccess access)
      : server_(address, access != DatabaseAccess::kRead) {
    if (access == DatabaseAccess::kCreate) {
      server_.in_transaction([&] { upgrade(); });
    } else if (const std::int64_t found = version(); found != kNewest) {
      server_.refuse(
          found == 0 ? "has no log of a hub"
                     : fmt::format("its log of a hub has version {}, expected {}", found, kNewest));
    }
    const Rows rows = server_.run("SELECT id FROM hub_id");
    if (rows.count() > 0) id_ = rows.text(0, 0);
  }

  std::int64_t mark(const std::string& node, const std::string& outbox) override {
    const Rows rows =
        server_.run("SELECT seq FROM hub_mark WHERE node = $1 AND outbox = $2", {node, outbox});
    return rows.count() > 0 ? rows.integer(0, 0) : 0;
  }

  std::vector<std::pair<std::string, Mark>> marks() override {
    std::vector<std::pair<std::string, Mark>> marks;
    const Rows rows = server_.run(
        "SELECT node, outbox, seq FROM hub_mark m WHERE updated = (SELECT max(updated) FROM "
        "hub_mark WHERE node = m.node) ORDER BY node COLLATE \"C\"");
    marks.reserve(rows.count());
    for (int k = 0; k < rows.count(); ++k)
      marks.push_back({rows.text(k, 0), {rows.text(k, 1), rows.integer(k, 2)}});
    return marks;
  }

  std::int64_t count() override {
    return server_.run("SELECT count(*) FROM hub_event").integer(0, 0);
  }

  void read(
      const std::function<bool(const std::string& node, const std::string& event)>& take) override {
    std::int64_t last = 0;
    for (bool more = true; more;) {
      const Rows rows =
          server_.run("SELECT id, node, event FROM hub_event WHERE id > $1 ORDER BY id LIMIT 1000",
                      {std::to_string(last)});
      more = rows.count() > 0;
      for (int k = 0; k < rows.count() && more; ++k) {
        last = rows.integer(k, 0);
        more = take(rows.text(k, 1), rows.text(k, 2));
      }
    }
  }

 private:
  [[nodiscard]] std::int64_t version() {
    if (server_.run("SELECT to_regclass('hub_version') IS NOT NULL").text(0, 0) != "t") return 0;
    const Rows rows = server_.run("SELECT version FROM hub_version");
    return rows.count() > 0 ? rows.integer(0, 0) : 0;
  }

  void upgrade() {
    // Only one hub at a time may create or change the tables.
    server_.run("SELECT pg_advisory_xact_lock(1414021681)");
    std::int64_t found = version();
    if (found > kNewest) {
      server_.refuse(
          fmt::format("its log of a hub has version {}, and this program knows {}: use a "
                      "newer one",
                      found, kNewest));
    }
    if (found == kNewest) return;
    if (found == 0) {
      if (server_.run("SELECT to_regclass('hub_event') IS NOT NULL").text(0, 0) == "t")
        server_.refuse("has a table hub_event that is of no hub");
      server_.run("CREATE TABLE hub_version(version BIGINT NOT NULL)");
      server_.run("INSERT INTO hub_version VALUES(0)");
    }
    for (; found < kNewest; ++found) {
      server_.run(kVersions[found]);
      if (found == 0) server_.run("INSERT INTO hub_id VALUES($1)", {random_id()});
    }
    server_.run("UPDATE hub_version SET version = $1", {std::to_string(kNewest)});
  }

  void in_transaction(const std::function<void()>& work) override { server_.in_transaction(work); }

  bool add(const Received& received, std::int64_t now_ms) override {
    const auto& [node, message] = received;
    return server_
        .run(
            "INSERT INTO hub_event(node, outbox, seq, received, event) VALUES($1, $2, $3, $4, $5) "
            "ON CONFLICT DO NOTHING",
            {node, message.outbox, std::to_string(message.seq), std::to_string(now_ms),
             message.event})
        .changed();
  }

  void raise_mark(const std::string& node, const std::string& outbox, std::int64_t seq) override {
    server_.run(
        "INSERT INTO hub_mark AS m(node, outbox, seq, updated) VALUES($1, $2, $3, (SELECT "
        "coalesce(max(updated), 0) + 1 FROM hub_mark)) ON CONFLICT(node, outbox) DO UPDATE SET seq "
        "= greatest(m.seq, excluded.seq), updated = excluded.updated",
        {node, outbox, std::to_string(seq)});
  }

  void numbers_after(const std::string& node, const std::string& outbox, std::int64_t seq,
                     const std::function<bool(std::int64_t)>& take) override {
    const Rows rows = server_.run(
        "SELECT seq FROM hub_event WHERE node = $1 AND outbox = $2 AND seq > $3 ORDER BY seq",
        {node, outbox, std::to_string(seq)});
    for (int k = 0; k < rows.count(); ++k) {
      if (!take(rows.integer(k, 0))) break;
    }
  }

  Server server_;
};

}  // namespace

std::string libpq_version(std::string& reason) {
  reason = library().missing;
  if (!reason.empty()) return {};
  const int number = library().version();
  return fmt::format("{}.{}", number / 10000, number % 10000);
}

std::unique_ptr<HubLog> open_postgres_hub_log(const std::string& address, DatabaseAccess access) {
  return std::make_unique<PostgresHubLog>(address, access);
}

}  // namespace tarsier::mqtt
