// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/errors.h"

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

struct sqlite3;
struct sqlite3_stmt;

namespace tarsier {

// SQLite files of this program. Committed data survives a crash of the program and of the machine
// (write-ahead log, synchronous FULL). Files are readable by their owner only (mode 0600); if
// others may open a file, the mode is restored at the next write, with a warning. Deleted rows are
// overwritten. Errors name the file and the problem: OutputError for databases opened for writing,
// InputError for others. Files may be hostile: triggers, views and functions of their schema are
// not run.

struct DatabaseKind {
  std::string name;                 // "Tarsier plate log", for errors
  std::int32_t application_id = 1;  // marks the files; not 0
  // element k has the statements that upgrade version k to k + 1
  std::vector<std::string> versions;
  // Oldest version that readers (kRead) support; see Database::version(). 0: only the newest.
  int oldest_readable = 0;
  // The format of another program: the files have neither our mark (application_id is 0) nor our
  // version. The single entry of `versions` creates the tables of an empty file. The file mode is
  // not changed.
  bool of_another_program = false;
};

// Another connection held the lock for longer than the timeout; a retry may succeed.
struct DatabaseLockedError : OutputError {
  using OutputError::OutputError;
};

enum class DatabaseAccess {
  kRead,    // the file must exist
  kWrite,   // the file must exist
  kCreate,  // created if it is missing or empty
};

class Database {
 public:
  // Throws if the file is locked for longer than `timeout_ms`, is not a database, is of another
  // kind, or has a newer version.
  Database(std::string path, const DatabaseKind& kind, DatabaseAccess access,
           int timeout_ms = 5000);
  ~Database();
  Database(Database&& other) noexcept;
  Database& operator=(Database&& other) noexcept;

  // Runs one or several statements without parameters and results.
  void run(std::string_view statements);
  // Rewrites the whole file without deleted data. The temporary copy is in memory for files up to
  // 64 MB, else in an unlinked temporary file.
  void vacuum();
  [[nodiscard]] std::int64_t version();     // of the file; for writers always the newest
  void set_lock_timeout(int milliseconds);  // how long to wait for a lock
  [[nodiscard]] std::int64_t last_row_id() const;
  [[nodiscard]] std::int64_t changed_rows() const;  // by the last statement
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  friend class Statement;
  [[noreturn]] void fail(int code) const;
  void check(int code) const;
  void open(DatabaseAccess access, int timeout_ms);
  void make_foreign(const DatabaseKind& kind);
  void identify(const DatabaseKind& kind);
  void upgrade(const DatabaseKind& kind);
  [[nodiscard]] std::int64_t number(const char* query);
  [[noreturn]] void refuse(const std::string& reason) const;
  [[noreturn]] void refuse(int code, const std::string& reason) const;

  std::string path_;
  bool writes_ = false;
  sqlite3* handle_ = nullptr;
};

// A prepared statement. As in SQLite, parameters count from 1 and columns from 0. Must not outlive
// its database.
class Statement {
 public:
  Statement(Database& database, std::string_view text);
  ~Statement();
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  Statement& bind(int parameter, std::int64_t value);
  Statement& bind(int parameter, double value);
  Statement& bind(int parameter, std::string_view text);
  Statement& bind(int parameter, std::span<const std::uint8_t> bytes);
  Statement& bind_null(int parameter);

  bool step();   // true: a row is available
  void reset();  // rewinds and clears the parameters

  [[nodiscard]] bool is_null(int column) const;
  [[nodiscard]] std::int64_t integer(int column) const;
  [[nodiscard]] double real(int column) const;
  [[nodiscard]] std::string text(int column) const;
  [[nodiscard]] std::vector<std::uint8_t> bytes(int column) const;

 private:
  Database& database_;
  sqlite3_stmt* handle_ = nullptr;
};

// All changes until commit() take effect together or not at all.
class Transaction {
 public:
  explicit Transaction(Database& database);
  ~Transaction();
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  void commit();

 private:
  Database& database_;
  bool open_ = true;
};

}  // namespace tarsier
