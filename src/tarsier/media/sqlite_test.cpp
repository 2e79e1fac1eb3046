// SPDX-License-Identifier: MIT
#include "tarsier/media/sqlite.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <optional>
#include <string>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

namespace tarsier {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

const DatabaseKind kKind{
    "test diary", 0x1234567, {"CREATE TABLE note(id INTEGER PRIMARY KEY, text)"}};

class SqliteTest : public FolderTest {
 protected:
  [[nodiscard]] Database create() const {
    return {path("notes.db"), kKind, DatabaseAccess::kCreate, 20};
  }
  [[nodiscard]] std::string refusal(DatabaseAccess access, const DatabaseKind& kind = kKind) const {
    try {
      const Database database(path("notes.db"), kind, access, 20);
    } catch (const IoError& error) {
      EXPECT_EQ(error.kind(),
                access == DatabaseAccess::kRead ? ErrorKind::kInput : ErrorKind::kOutput);
      EXPECT_THAT(error.what(), AllOf(HasSubstr("notes.db: "), Not(HasSubstr("\n"))));
      return error.what();
    }
    return "accepted";
  }
  static void add(Database& database, const std::string& text) {
    Statement statement(database, "INSERT INTO note(text) VALUES(?)");
    EXPECT_FALSE(statement.bind(1, std::string_view(text)).step());
  }
  static std::vector<std::string> notes(Database& database) {
    std::vector<std::string> texts;
    Statement statement(database, "SELECT text FROM note ORDER BY id");
    while (statement.step()) texts.push_back(statement.text(0));
    return texts;
  }
};

TEST_F(SqliteTest, ValuesRoundTrip) {
  Database database = create();
  Statement insert(database, "INSERT INTO note(id, text) VALUES(?, ?)");
  const std::vector<std::uint8_t> bytes{0, 255, 7, 0};
  insert.bind(1, std::int64_t{1} << 40).bind(2, std::span<const std::uint8_t>(bytes)).step();
  insert.reset();
  insert.bind(1, std::int64_t{2})
      .bind(2, std::string_view("a\0b'; DROP TABLE note; --", 25))
      .step();
  insert.reset();
  insert.bind(1, std::int64_t{3}).bind(2, 0.1).step();
  insert.reset();
  insert.bind(1, std::int64_t{4}).bind_null(2).step();
  EXPECT_EQ(database.last_row_id(), 4);
  Statement read(database, "SELECT text, id FROM note ORDER BY id");
  ASSERT_TRUE(read.step());
  EXPECT_EQ(read.integer(1), 2);
  EXPECT_EQ(read.text(0), std::string("a\0b'; DROP TABLE note; --", 25));
  ASSERT_TRUE(read.step());
  EXPECT_EQ(read.real(0), 0.1);
  ASSERT_TRUE(read.step());
  EXPECT_TRUE(read.is_null(0));
  ASSERT_TRUE(read.step());
  EXPECT_EQ(read.bytes(0), bytes);
  EXPECT_FALSE(read.step());
}

TEST_F(SqliteTest, FilesAreReadableByTheOwnerOnly) {
  const mode_t before = umask(0);
  Database database = create();
  add(database, "x");
  umask(before);
  for (const auto& entry : std::filesystem::directory_iterator(folder_)) {
    struct stat found {};
    ASSERT_EQ(stat(entry.path().c_str(), &found), 0);
    EXPECT_EQ(found.st_mode & 0777U, 0600U) << entry.path();
  }
  EXPECT_EQ(files(), 3U);  // the log and its index beside the file
}

TEST_F(SqliteTest, PermissionsAreTightenedOnWriting) {
  const auto mode_of = [](const std::string& file) {
    struct stat found {};
    EXPECT_EQ(stat(file.c_str(), &found), 0) << file;
    return found.st_mode & 0777U;
  };
  Database holder = create();  // keeps the log and its index alive
  add(holder, "x");
  const std::string file = path("notes.db");
  const std::vector<std::string> all{file, file + "-wal", file + "-shm"};
  for (const std::string& one : all) ASSERT_EQ(chmod(one.c_str(), 0664), 0);
  testing::internal::CaptureStderr();
  { const Database reader(file, kKind, DatabaseAccess::kRead, 20); }
  EXPECT_THAT(
      testing::internal::GetCapturedStderr(),
      AllOf(HasSubstr("notes.db: other users may open it (mode 0664)"), HasSubstr("chmod 600")));
  EXPECT_EQ(mode_of(file), 0664U) << "reading changes nothing";
  testing::internal::CaptureStderr();
  {
    Database writer(file, kKind, DatabaseAccess::kWrite, 20);
    add(writer, "y");
  }
  EXPECT_THAT(testing::internal::GetCapturedStderr(),
              HasSubstr("notes.db: other users could open it (mode 0664); now only you can"));
  for (const std::string& one : all) EXPECT_EQ(mode_of(one), 0600U) << one;
  testing::internal::CaptureStderr();
  { const Database writer(file, kKind, DatabaseAccess::kCreate, 20); }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "") << "said once";
  EXPECT_THAT(notes(holder), ElementsAre("x", "y"));
}

TEST_F(SqliteTest, CommittedDataSurvivesACrash) {
  const pid_t child = fork();
  if (child == 0) {
    Database database = create();
    add(database, "kept");
    const Transaction transaction(database);
    add(database, "never committed");
    _exit(7);  // closes nothing
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  ASSERT_EQ(WEXITSTATUS(status), 7);
  Database database(path("notes.db"), kKind, DatabaseAccess::kRead, 20);
  EXPECT_THAT(notes(database), ElementsAre("kept"));
}

TEST_F(SqliteTest, ALockedDatabaseIsAnErrorAndLosesNothing) {
  Database first = create();
  add(first, "one");
  std::optional<Transaction> lock(std::in_place, first);
  Database second(path("notes.db"), kKind, DatabaseAccess::kWrite, 20);
  try {
    add(second, "two");
    FAIL();
  } catch (const OutputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("notes.db: is locked by another program"));
  }
  EXPECT_THAT(notes(second), ElementsAre("one"));  // reading continues
  lock.reset();
  add(second, "two");
  EXPECT_THAT(notes(first), ElementsAre("one", "two"));
}

TEST_F(SqliteTest, ExclusiveLockBlocksReaders) {
  { const Database database = create(); }
  Database holder(path("notes.db"), kKind, DatabaseAccess::kWrite, 20);
  holder.run("PRAGMA locking_mode = EXCLUSIVE; BEGIN EXCLUSIVE");
  EXPECT_THAT(refusal(DatabaseAccess::kRead), HasSubstr("locked"));
  EXPECT_THAT(refusal(DatabaseAccess::kWrite), HasSubstr("locked"));
  EXPECT_THAT(refusal(DatabaseAccess::kCreate), HasSubstr("locked"));
}

TEST_F(SqliteTest, AFullDatabaseIsAnErrorAndLosesNothing) {
  Database database = create();
  add(database, "one");
  database.run("PRAGMA max_page_count = 6");
  std::string reason;
  int added = 0;
  try {
    for (; added < 100; ++added) add(database, std::string(1000, 'x'));
  } catch (const OutputError& error) {
    reason = error.what();
  }
  EXPECT_THAT(reason, HasSubstr("notes.db: no room left"));
  EXPECT_EQ(notes(database).size(), 1U + static_cast<std::size_t>(added));
  database.run("PRAGMA max_page_count = 1000");
  add(database, "later");
  EXPECT_EQ(notes(database).back(), "later");
}

TEST_F(SqliteTest, OtherFilesAreRefusedAndUnchanged) {
  EXPECT_THAT(refusal(DatabaseAccess::kRead), HasSubstr("No such file"));
  EXPECT_THAT(refusal(DatabaseAccess::kWrite), HasSubstr("No such file"));
  const std::string text = "dear diary, " + std::string(2000, 'x');
  for (const std::string& bytes : {text, std::string("short"), std::string(1000, '\0')}) {
    write_file_atomically(path("notes.db"), bytes);
    for (const DatabaseAccess access :
         {DatabaseAccess::kRead, DatabaseAccess::kWrite, DatabaseAccess::kCreate}) {
      EXPECT_THAT(refusal(access), HasSubstr("is not a database")) << bytes.size();
    }
    EXPECT_EQ(contents(path("notes.db")), bytes);
    EXPECT_EQ(files(), 1U);
  }
}

TEST_F(SqliteTest, ForeignDatabasesAreRefusedAndUnchanged) {
  {
    const DatabaseKind other{"other", 77, {"CREATE TABLE song(title)"}};
    const Database database(path("notes.db"), other, DatabaseAccess::kCreate);
  }
  const std::string before = contents(path("notes.db"));
  EXPECT_THAT(refusal(DatabaseAccess::kRead), HasSubstr("is not a test diary"));
  EXPECT_THAT(refusal(DatabaseAccess::kCreate), HasSubstr("is not a test diary"));
  EXPECT_EQ(contents(path("notes.db")), before);
}

TEST_F(SqliteTest, AnEmptyFileBecomesADatabaseOnlyForWriting) {
  write_file_atomically(path("notes.db"), std::string_view());
  EXPECT_THAT(refusal(DatabaseAccess::kRead), HasSubstr("is empty: no test diary"));
  Database database = create();
  add(database, "x");
  EXPECT_EQ(notes(database).size(), 1U);
}

TEST_F(SqliteTest, OlderVersionsAreUpgradedAndNewerOnesRefused) {
  {
    Database database = create();
    add(database, "old");
  }
  DatabaseKind newer = kKind;
  newer.versions.emplace_back("ALTER TABLE note ADD COLUMN mood; UPDATE note SET mood = 'good'");
  EXPECT_THAT(refusal(DatabaseAccess::kRead, newer), HasSubstr("older version 1"));
  {
    Database database(path("notes.db"), newer, DatabaseAccess::kWrite);
    Statement statement(database, "SELECT text || mood FROM note");
    ASSERT_TRUE(statement.step());
    EXPECT_EQ(statement.text(0), "oldgood");
  }
  EXPECT_THAT(refusal(DatabaseAccess::kRead), HasSubstr("version 2, this program knows 1..1"));
  EXPECT_THAT(refusal(DatabaseAccess::kCreate), HasSubstr("version 2"));
}

TEST_F(SqliteTest, FailedUpgradeIsRolledBack) {
  {
    Database database = create();
    add(database, "old");
  }
  DatabaseKind broken = kKind;
  broken.versions.emplace_back("DELETE FROM note; CREATE TABLE note(x)");
  EXPECT_THAT(refusal(DatabaseAccess::kWrite, broken), HasSubstr("already exists"));
  Database database(path("notes.db"), kKind, DatabaseAccess::kRead);
  EXPECT_THAT(notes(database), ElementsAre("old"));
}

TEST_F(SqliteTest, VacuumErasesDeletedData) {
  Database database = create();
  add(database, "stays");
  add(database, std::string(20000, 'x') + "secret");
  database.run(
      "PRAGMA secure_delete = OFF; DELETE FROM note WHERE id = 2;"
      "PRAGMA wal_checkpoint(TRUNCATE)");
  ASSERT_THAT(contents(path("notes.db")), HasSubstr("secret"));
  database.vacuum();
  database.run("PRAGMA wal_checkpoint(TRUNCATE)");
  EXPECT_THAT(contents(path("notes.db")), Not(HasSubstr("secret")));
  EXPECT_LT(contents(path("notes.db")).size(), 20000U);
  EXPECT_THAT(notes(database), ElementsAre("stays"));
}

TEST_F(SqliteTest, ALargeFileIsNotCopiedInMemory) {
  Database database = create();
  const auto copies_to = [&]() -> std::int64_t {
    Statement statement(database, "PRAGMA temp_store");
    return statement.step() ? statement.integer(0) : -1;
  };
  constexpr std::int64_t kFile = 1;
  constexpr std::int64_t kMemory = 2;
  database.vacuum();
  EXPECT_EQ(copies_to(), kMemory);
  database.run("INSERT INTO note(text) VALUES(zeroblob(65 * 1024 * 1024))");
  database.vacuum();
  EXPECT_EQ(copies_to(), kFile);
  database.run("DELETE FROM note");
  database.vacuum();
  database.vacuum();
  EXPECT_EQ(copies_to(), kMemory) << "small again";
}

TEST_F(SqliteTest, DamagedFileIsAnError) {
  {
    Database database = create();
    for (int k = 0; k < 200; ++k) add(database, std::string(500, 'x'));
  }
  std::string bytes = contents(path("notes.db"));
  for (std::size_t at = 4096; at < bytes.size(); ++at) bytes[at] = static_cast<char>(at * 31 % 251);
  write_file_atomically(path("notes.db"), bytes);
  try {
    Database database(path("notes.db"), kKind, DatabaseAccess::kRead, 20);
    (void)notes(database);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("is damaged"));
  }
}

TEST_F(SqliteTest, FoldersAndInvalidPathsAreRefused) {
  std::filesystem::create_directory(path("notes.db"));
  EXPECT_THAT(refusal(DatabaseAccess::kRead), HasSubstr("not a regular file"));
  EXPECT_THAT(refusal(DatabaseAccess::kCreate), HasSubstr("not a regular file"));
  EXPECT_THROW(Database(path("missing/notes.db"), kKind, DatabaseAccess::kCreate), OutputError);
  EXPECT_THROW(Database("", kKind, DatabaseAccess::kCreate), OutputError);
  EXPECT_THROW(Database(":memory:", kKind, DatabaseAccess::kRead), InputError);
}

TEST_F(SqliteTest, ALockHasItsOwnTypeOfError) {
  Database database = create();
  Database other = create();
  const Transaction lock(other);
  EXPECT_THROW(add(database, "hello"), DatabaseLockedError);
  EXPECT_THROW(Transaction{database}, DatabaseLockedError);
  EXPECT_THROW(database.run("CREATE TABLE again(id)"), DatabaseLockedError);
}

TEST_F(SqliteTest, ReadersMayAcceptOlderVersions) {
  (void)create();
  DatabaseKind later = kKind;
  later.versions.emplace_back("ALTER TABLE note ADD COLUMN time");
  EXPECT_THAT(refusal(DatabaseAccess::kRead, later), HasSubstr("older version 1"));
  later.oldest_readable = 1;
  EXPECT_EQ(Database(path("notes.db"), later, DatabaseAccess::kRead).version(), 1);
  EXPECT_EQ(Database(path("notes.db"), later, DatabaseAccess::kWrite).version(), 2);
}

}  // namespace
}  // namespace tarsier
