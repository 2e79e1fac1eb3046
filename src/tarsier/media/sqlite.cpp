// SPDX-License-Identifier: MIT
#include "tarsier/media/sqlite.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"

#include <fmt/format.h>

#include <cerrno>
#include <climits>
#include <cstring>
#include <fcntl.h>
#include <sqlite3.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

namespace tarsier {
namespace {

constexpr int kMaxValueBytes = 256'000'000;  // of one text, blob or row
// Larger files are not copied in memory.
constexpr std::int64_t kMaxCopied = std::int64_t{64} * 1024 * 1024;

// Creates an empty file that nobody else may read; an existing file stays as it is. An existing
// file is not opened, because closing it would drop the locks of other connections of this process.
int make_private_file(const std::string& path) {
  const int file = ::open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (file < 0) return errno == EEXIST ? 0 : errno;
  ::close(file);
  return 0;
}

// A database that others may read (made by an older version, or copied by hand) is made private
// before anything is written to it. If it is only read, it stays as it is.
void check_permissions(const std::string& path, bool writes) {
  constexpr mode_t kGroupAndOthers = 077;
  struct stat found {};
  if (::stat(path.c_str(), &found) != 0 || (found.st_mode & kGroupAndOthers) == 0) return;
  const auto mode = static_cast<unsigned>(found.st_mode & 0777U);
  if (!writes) {
    log_warning("{}: other users may open it (mode {:04o}): chmod 600 keeps it to you", path, mode);
    return;
  }
  if (::chmod(path.c_str(), 0600) != 0) {
    log_warning("{}: other users may open it (mode {:04o}), and that cannot be changed: {}", path,
                mode, errno_text(errno));
    return;
  }
  // SQLite creates these files later with the mode of the database.
  for (const char* extension : {"-wal", "-shm", "-journal"}) {
    const std::string companion = path + extension;
    if (::chmod(companion.c_str(), 0600) != 0 && errno != ENOENT) {
      log_warning("{}: other users may open it: {}", companion, errno_text(errno));
    }
  }
  log_warning("{}: other users could open it (mode {:04o}); now only you can (0600)", path, mode);
}

std::string reason_of(sqlite3* handle, int code) {
  const int system_error = handle == nullptr ? 0 : sqlite3_system_errno(handle);
  switch (code & 0xFF) {
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return "is locked by another program";
    case SQLITE_FULL:
      return "no room left to write";
    case SQLITE_READONLY:
      return "may not be written";
    case SQLITE_NOTADB:
      return "is not a database";
    case SQLITE_CORRUPT:
      return "is damaged";
    case SQLITE_NOMEM:
      return "not enough memory";
    case SQLITE_CANTOPEN:
      return "cannot be opened" + (system_error != 0 ? ": " + errno_text(system_error) : "");
    case SQLITE_IOERR:
      return "reading or writing failed" +
             (system_error != 0 ? ": " + errno_text(system_error) : "");
    default:
      return printable(handle == nullptr ? sqlite3_errstr(code) : sqlite3_errmsg(handle));
  }
}

}  // namespace

Database::Database(std::string path, const DatabaseKind& kind, DatabaseAccess access,
                   int timeout_ms)
    : path_(std::move(path)), writes_(access != DatabaseAccess::kRead) {
  TARSIER_REQUIRE((kind.application_id == 0) == kind.of_another_program && !kind.versions.empty(),
                  "kind {}", kind.name);
  TARSIER_REQUIRE(timeout_ms >= 0, "patience {} ms", timeout_ms);
  try {
    open(access, timeout_ms);
    if (kind.of_another_program) {
      make_foreign(kind);
      return;
    }
    identify(kind);
    check_permissions(path_, writes_);  // only for our own databases
    if (writes_) upgrade(kind);
  } catch (...) {
    sqlite3_close_v2(handle_);
    throw;
  }
}

Database::~Database() { sqlite3_close_v2(handle_); }

Database::Database(Database&& other) noexcept
    : path_(std::move(other.path_)),
      writes_(other.writes_),
      handle_(std::exchange(other.handle_, nullptr)) {}

Database& Database::operator=(Database&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(writes_, other.writes_);
  std::swap(handle_, other.handle_);
  return *this;
}

void Database::refuse(const std::string& reason) const {
  if (writes_) throw OutputError(path_, reason);
  throw InputError(path_, reason);
}

void Database::refuse(int code, const std::string& reason) const {
  const int kind = code & 0xFF;
  if (writes_ && (kind == SQLITE_BUSY || kind == SQLITE_LOCKED)) {
    throw DatabaseLockedError(path_, reason);
  }
  refuse(reason);
}

void Database::fail(int code) const { refuse(code, reason_of(handle_, code)); }

void Database::check(int code) const {
  if (code != SQLITE_OK) fail(code);
}

void Database::open(DatabaseAccess access, int timeout_ms) {
  struct stat found {};
  const bool exists = ::stat(path_.c_str(), &found) == 0;
  if (exists && !S_ISREG(found.st_mode)) refuse("is not a regular file");
  if (!exists && (access != DatabaseAccess::kCreate || errno != ENOENT)) {
    refuse(errno_text(errno));
  }
  if (access == DatabaseAccess::kCreate) {
    if (const int error = make_private_file(path_); error != 0) refuse(errno_text(error));
  }
  // A leading slash or dot keeps SQLite from interpreting the name as a special one.
  const std::string plain = path_.starts_with('/') ? path_ : "./" + path_;
  const int flags =
      (writes_ ? SQLITE_OPEN_READWRITE : SQLITE_OPEN_READONLY) | SQLITE_OPEN_EXRESCODE;
  check(sqlite3_open_v2(plain.c_str(), &handle_, flags, nullptr));
  check(sqlite3_busy_timeout(handle_, timeout_ms));
  check(sqlite3_db_config(handle_, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr));
  check(sqlite3_db_config(handle_, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr));
  check(sqlite3_db_config(handle_, SQLITE_DBCONFIG_ENABLE_TRIGGER, 0, nullptr));
  check(sqlite3_db_config(handle_, SQLITE_DBCONFIG_ENABLE_VIEW, 0, nullptr));
  sqlite3_limit(handle_, SQLITE_LIMIT_LENGTH, kMaxValueBytes);
  sqlite3_limit(handle_, SQLITE_LIMIT_ATTACHED, 0);
}

void Database::make_foreign(const DatabaseKind& kind) {
  const bool empty = number("SELECT count(*) FROM sqlite_schema") == 0;
  if (empty && !writes_) refuse("is empty: no " + kind.name);
  if (!writes_) return;
  run("PRAGMA foreign_keys = ON");
  if (!empty) return;
  Transaction transaction(*this);
  run(kind.versions.front());
  transaction.commit();
}

// Checks before anything is written: a file of another program stays unchanged.
void Database::identify(const DatabaseKind& kind) {
  const std::int64_t application = number("PRAGMA application_id");
  const std::int64_t version = number("PRAGMA user_version");
  const bool empty = number("SELECT count(*) FROM sqlite_schema") == 0;
  if (empty && application == 0 && version == 0) {
    if (!writes_) refuse("is empty: no " + kind.name);
    return;
  }
  if (application != kind.application_id) refuse("is not a " + kind.name);
  const auto newest = static_cast<std::int64_t>(kind.versions.size());
  if (version > newest || version < 1) {
    refuse(
        fmt::format("is a {} of version {}, this program knows 1..{}", kind.name, version, newest));
  }
  const std::int64_t oldest = kind.oldest_readable > 0 ? kind.oldest_readable : newest;
  if (!writes_ && version < oldest) {
    // Reading must not change the file, and the caller's queries would not fit an older layout.
    refuse(
        fmt::format("is a {} of the older version {}: it is brought up to date when it is "
                    "next written to",
                    kind.name, version));
  }
}

void Database::upgrade(const DatabaseKind& kind) {
  if (number("PRAGMA user_version") == 0) run("PRAGMA auto_vacuum = INCREMENTAL");
  run("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA secure_delete = ON;"
      "PRAGMA foreign_keys = ON");
  const auto newest = static_cast<std::int64_t>(kind.versions.size());
  if (number("PRAGMA user_version") == newest) return;
  Transaction transaction(*this);
  // Another program may have upgraded it meanwhile.
  for (std::int64_t version = number("PRAGMA user_version"); version < newest; ++version) {
    run(kind.versions[static_cast<std::size_t>(version)]);
  }
  run(fmt::format("PRAGMA application_id = {}; PRAGMA user_version = {}", kind.application_id,
                  newest));
  transaction.commit();
}

std::int64_t Database::number(const char* query) {
  Statement statement(*this, query);
  return statement.step() ? statement.integer(0) : 0;
}

void Database::run(std::string_view statements) {
  const std::string text(statements);
  check(sqlite3_exec(handle_, text.c_str(), nullptr, nullptr, nullptr));
}

void Database::vacuum() {
  // SQLite unlinks its copy and makes it private (in SQLITE_TMPDIR, TMPDIR or /var/tmp).
  const std::int64_t bytes = number("PRAGMA page_count") * number("PRAGMA page_size");
  run(bytes <= kMaxCopied ? "PRAGMA temp_store = MEMORY" : "PRAGMA temp_store = FILE");
  // The copy is attached under a name of its own.
  const int before = sqlite3_limit(handle_, SQLITE_LIMIT_ATTACHED, 1);
  const int code = sqlite3_exec(handle_, "VACUUM", nullptr, nullptr, nullptr);
  sqlite3_limit(handle_, SQLITE_LIMIT_ATTACHED, before);
  check(code);
}

std::int64_t Database::version() { return number("PRAGMA user_version"); }

void Database::set_lock_timeout(int milliseconds) {
  TARSIER_REQUIRE(milliseconds >= 0, "patience {} ms", milliseconds);
  check(sqlite3_busy_timeout(handle_, milliseconds));
}

std::int64_t Database::last_row_id() const { return sqlite3_last_insert_rowid(handle_); }

std::int64_t Database::changed_rows() const { return sqlite3_changes64(handle_); }

Statement::Statement(Database& database, std::string_view text) : database_(database) {
  TARSIER_REQUIRE(text.size() < static_cast<std::size_t>(INT_MAX), "statement of {} bytes",
                  text.size());
  database_.check(sqlite3_prepare_v2(database_.handle_, text.data(), static_cast<int>(text.size()),
                                     &handle_, nullptr));
}

Statement::~Statement() { sqlite3_finalize(handle_); }

Statement& Statement::bind(int parameter, std::int64_t value) {
  database_.check(sqlite3_bind_int64(handle_, parameter, value));
  return *this;
}

Statement& Statement::bind(int parameter, double value) {
  database_.check(sqlite3_bind_double(handle_, parameter, value));
  return *this;
}

Statement& Statement::bind(int parameter, std::string_view text) {
  database_.check(sqlite3_bind_text64(handle_, parameter, text.data() == nullptr ? "" : text.data(),
                                      text.size(), SQLITE_TRANSIENT, SQLITE_UTF8));
  return *this;
}

Statement& Statement::bind(int parameter, std::span<const std::uint8_t> bytes) {
  database_.check(
      sqlite3_bind_blob64(handle_, parameter, bytes.data(), bytes.size(), SQLITE_TRANSIENT));
  return *this;
}

Statement& Statement::bind_null(int parameter) {
  database_.check(sqlite3_bind_null(handle_, parameter));
  return *this;
}

bool Statement::step() {
  const int code = sqlite3_step(handle_);
  if (code == SQLITE_ROW) return true;
  if (code == SQLITE_DONE) return false;
  // The next call overwrites the message. The transaction continues without this statement.
  const std::string reason = reason_of(database_.handle_, code);
  sqlite3_reset(handle_);
  database_.refuse(code, reason);
}

void Statement::reset() {
  sqlite3_reset(handle_);
  sqlite3_clear_bindings(handle_);
}

bool Statement::is_null(int column) const {
  return sqlite3_column_type(handle_, column) == SQLITE_NULL;
}

std::int64_t Statement::integer(int column) const { return sqlite3_column_int64(handle_, column); }

double Statement::real(int column) const { return sqlite3_column_double(handle_, column); }

std::string Statement::text(int column) const {
  const unsigned char* data = sqlite3_column_text(handle_, column);
  const auto size = static_cast<std::size_t>(sqlite3_column_bytes(handle_, column));
  return data == nullptr ? std::string() : std::string(reinterpret_cast<const char*>(data), size);
}

std::vector<std::uint8_t> Statement::bytes(int column) const {
  const auto* data = static_cast<const std::uint8_t*>(sqlite3_column_blob(handle_, column));
  const auto size = static_cast<std::size_t>(sqlite3_column_bytes(handle_, column));
  return data == nullptr ? std::vector<std::uint8_t>()
                         : std::vector<std::uint8_t>(data, data + size);
}

Transaction::Transaction(Database& database) : database_(database) {
  database_.run("BEGIN IMMEDIATE");
}

Transaction::~Transaction() {
  if (!open_) return;
  try {
    database_.run("ROLLBACK");
  } catch (const Error&) {
    // The error that brought us here has rolled it back already.
  }
}

void Transaction::commit() {
  database_.run("COMMIT");
  open_ = false;
}

}  // namespace tarsier
