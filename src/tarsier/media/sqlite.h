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

// SQLite files of our own. What is committed survives a crash of the program and of the machine
// (write-ahead log, synchronous FULL); files are made for their owner's eyes only (mode 0600), and
// made so again when one that others may open is written to (a warning says it);
// deleted rows are overwritten. Errors name the file and what is wrong with it: OutputError from
// databases that were opened to be written, InputError from the others. Files may be hostile:
// triggers, views and functions in their schema are not run.

struct DatabaseKind {
  std::string name;                   // "Tarsier plate log", for errors
  std::int32_t application_id = 1;    // marks the files; not 0
  std::vector<std::string> versions;  // the k-th are the statements that turn version k into k + 1
  // Readers (kRead) understand versions from this one on: see Database::version(). 0: the newest
  // alone.
  int oldest_readable = 0;
  // The format of another program: the files have neither mark (application_id is 0) nor version of
  // ours. The one entry of `versions` makes the tables of an empty one. Who may open them is left alone.
  bool of_another_program = false;
};

// Another connection held its lock for longer than the patience: the same may work later.
struct DatabaseLockedError : OutputError {
  using OutputError::OutputError;
};

enum class DatabaseAccess {
  kRead,    // the file must be there
  kWrite,   // the same
  kCreate,  // it is made if it is not there or empty
};

class Database {
 public:
  // Throws when it is locked for longer than `patience_ms`, no database, of another kind, or of a
  // newer version.
  Database(std::string path, const DatabaseKind& kind, DatabaseAccess access,
           int patience_ms = 5000);
  ~Database();
  Database(Database&& other) noexcept;
  Database& operator=(Database&& other) noexcept;

  // One or several statements without parameters or results.
  void run(std::string_view statements);
  // Writes the whole file afresh, without what was deleted. The copy on the way is in memory for
  // files up to 64 MB, else in a temporary file that has no name.
  void vacuum();
  [[nodiscard]] std::int64_t version();  // of the file; writers find the newest one
  void set_patience(int milliseconds);   // how long a lock is waited for
  [[nodiscard]] std::int64_t last_row_id() const;
  [[nodiscard]] std::int64_t changed_rows() const;  // by the last statement
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  friend class Statement;
  [[noreturn]] void fail(int code) const;
  void check(int code) const;
  void open(DatabaseAccess access, int patience_ms);
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

// A prepared statement. Parameters and columns count from 1 and from 0, as SQLite's do. Must not
// outlive its database.
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

  bool step();   // true: at a row
  void reset();  // to the beginning, parameters unset

  [[nodiscard]] bool is_null(int column) const;
  [[nodiscard]] std::int64_t integer(int column) const;
  [[nodiscard]] double real(int column) const;
  [[nodiscard]] std::string text(int column) const;
  [[nodiscard]] std::vector<std::uint8_t> bytes(int column) const;

 private:
  Database& database_;
  sqlite3_stmt* handle_ = nullptr;
};

// What happens until commit() happens together or not at all.
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
