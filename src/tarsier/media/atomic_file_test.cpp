// SPDX-License-Identifier: MIT
#include "tarsier/media/atomic_file.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <thread>
#include <unistd.h>
#include <vector>

namespace tarsier {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

using AtomicFileTest = FolderTest;

TEST_F(AtomicFileTest, WritesAndReplaces) {
  write_file_atomically(path("a"), std::string_view("first"));
  write_file_atomically(path("a"), std::string_view("2nd"));
  EXPECT_EQ(contents(path("a")), "2nd");
  EXPECT_EQ(files(), 1U);
}

// The next writer in the folder removes the temporary file of a killed program. It keeps the file
// of a running program, and files with similar names.
TEST_F(AtomicFileTest, RemovesLeftoversOfAKilledProgram) {
  std::ofstream(path(".a.tarsier-00ab12.png")) << "half";
  std::ofstream(path(".a.b.tarsier-ffffff")) << "half";
  std::ofstream(path(".busy.tarsier-00ab12.mp4")) << "half";
  std::ofstream(path(".a.tarsier-00ab1.png")) << "somebody's";
  std::ofstream(path("a.tarsier-00ab12.png")) << "somebody's";
  fs::create_directory(path(".d.tarsier-00ab12"));
  std::ofstream(path(".d.tarsier-00ab12/a.png")) << "half";
  const int busy = ::open(path(".busy.tarsier-00ab12.mp4").c_str(), O_WRONLY | O_CLOEXEC);
  ASSERT_EQ(::flock(busy, LOCK_EX), 0);
  write_file_atomically(path("a.png"), std::string_view("whole"));
  ::close(busy);
  EXPECT_FALSE(fs::exists(path(".a.tarsier-00ab12.png")));
  EXPECT_FALSE(fs::exists(path(".a.b.tarsier-ffffff")));
  EXPECT_TRUE(fs::exists(path(".busy.tarsier-00ab12.mp4")));
  EXPECT_TRUE(fs::exists(path(".a.tarsier-00ab1.png")));
  EXPECT_TRUE(fs::exists(path("a.tarsier-00ab12.png")));
  EXPECT_FALSE(fs::exists(path(".d.tarsier-00ab12")));
  EXPECT_EQ(contents(path("a.png")), "whole");
}

// A file that may hold hours of work is reported and not removed.
TEST_F(AtomicFileTest, KeepsLargeAbandonedFilesWithWarning) {
  const std::string video = path(".video.tarsier-00ab12.mp4");
  const std::string model = path(".model.tarsier-00ab12");
  std::ofstream(video) << "video";
  fs::resize_file(video, 10'000'001);
  fs::create_directories(model + "/deep");
  std::ofstream(model + "/deep/points") << "points";
  fs::resize_file(model + "/deep/points", 12'000'000);
  std::ofstream(path(".small.tarsier-00ab12.mp4")) << "small";
  fs::resize_file(path(".small.tarsier-00ab12.mp4"), 10'000'000);
  testing::internal::CaptureStderr();
  write_file_atomically(path("a.png"), std::string_view("whole"));
  const std::string log_output = testing::internal::GetCapturedStderr();
  EXPECT_THAT(log_output, HasSubstr(video + ": left by a program that was killed (10 MB)"));
  EXPECT_THAT(log_output, HasSubstr(model + ": left by a program that was killed (12 MB)"));
  EXPECT_THAT(log_output, testing::Not(HasSubstr("small")));
  EXPECT_TRUE(fs::exists(video));
  EXPECT_TRUE(fs::exists(model + "/deep/points"));
  EXPECT_FALSE(fs::exists(path(".small.tarsier-00ab12.mp4")));
}

TEST_F(AtomicFileTest, LocksTemporaryFile) {
  const AtomicFile file(path("a.mp4"));
  const int other = ::open(file.path().c_str(), O_RDONLY | O_CLOEXEC);
  EXPECT_NE(::flock(other, LOCK_EX | LOCK_NB), 0);
  ::close(other);
}

TEST_F(AtomicFileTest, LocksTheFolderOfAFile) {
  const auto is_free = [&] {
    const FileDescriptor other(::open(path("").c_str(), O_RDONLY | O_CLOEXEC));
    return ::flock(other.get(), LOCK_EX | LOCK_NB) == 0;
  };
  {
    const FileDescriptor lock = lock_folder_of(path("list.csv"));
    EXPECT_FALSE(is_free());
  }
  EXPECT_TRUE(is_free());
  EXPECT_LT(lock_folder_of(path("missing/list.csv")).get(), 0);
}

TEST_F(AtomicFileTest, AFolderAppearsCompletelyOrNotAtAll) {
  {
    const AtomicFolder folder(path("deep/all"));
    write_file_atomically(folder.path() + "/a", std::string_view("1"));
    EXPECT_FALSE(fs::exists(path("deep/all")));
  }
  EXPECT_TRUE(fs::is_empty(path("deep")));
  AtomicFolder folder(path("deep/all/"));
  write_file_atomically(folder.path() + "/a", std::string_view("1"));
  folder.commit();
  EXPECT_EQ(contents(path("deep/all/a")), "1");
  EXPECT_EQ(fs::status(path("deep/all")).permissions(), fs::perms::owner_all);
  EXPECT_THROW(AtomicFolder(path("deep/all")), OutputError);
  EXPECT_THROW(AtomicFolder(path("deep/all/a")), OutputError);
}

TEST_F(AtomicFileTest, AnEmptyFolderIsFilledInPlace) {
  fs::create_directory(path("disk"));
  {
    const AtomicFolder folder(path("disk"));
    fs::create_directory(folder.path() + "/people");
    std::ofstream(folder.path() + "/people/a") << "half";
  }
  EXPECT_TRUE(fs::is_empty(path("disk")));
  AtomicFolder folder(path("disk"));
  std::ofstream(folder.path() + "/a") << "whole";
  folder.commit();
  EXPECT_EQ(contents(path("disk/a")), "whole");
}

TEST_F(AtomicFileTest, NewFilesFollowTheUmaskAndOldOnesKeepTheirMode) {
  const mode_t old = ::umask(027);
  write_file_atomically(path("new"), std::string_view("x"));
  ::umask(old);
  EXPECT_EQ(fs::status(path("new")).permissions(), fs::perms{0640});
  fs::permissions(path("new"), fs::perms{0600});
  write_file_atomically(path("new"), std::string_view("y"));
  EXPECT_EQ(fs::status(path("new")).permissions(), fs::perms{0600});
}

TEST_F(AtomicFileTest, WithoutCommitLeavesNoFile) {
  write_file_atomically(path("a.mp4"), std::string_view("old"));
  {
    const AtomicFile file(path("a.mp4"));
    EXPECT_EQ(fs::path(file.path()).extension(), ".mp4");
    EXPECT_EQ(fs::path(file.path()).parent_path(), folder_);
    EXPECT_NE(file.path(), path("a.mp4"));
    std::ofstream(file.path()) << "half";
    EXPECT_EQ(files(), 2U);
  }
  EXPECT_EQ(contents(path("a.mp4")), "old");
  EXPECT_EQ(files(), 1U);
}

TEST_F(AtomicFileTest, FileSizeLimitKeepsOldFile) {
  write_file_atomically(path("a"), std::string_view("old"));
  // As on a full disk: the write fails in the middle.
  struct ::rlimit before {};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  struct ::rlimit small = before;
  small.rlim_cur = 1000;
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  std::string reason;
  try {
    write_file_atomically(path("a"), std::string(5000, 'x'));
  } catch (const OutputError& error) {
    reason = error.what();
  }
  ::setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  EXPECT_THAT(reason, HasSubstr(path("a") + ": cannot write"));
  EXPECT_EQ(contents(path("a")), "old");
  EXPECT_EQ(files(), 1U);
}

TEST_F(AtomicFileTest, DevicesAndPipesAreWrittenDirectly) {
  EXPECT_THROW(write_file_atomically("/dev/full", std::string_view("x")), OutputError);
  write_file_atomically("/dev/null", std::string_view("x"));
  ASSERT_EQ(::mkfifo(path("pipe").c_str(), 0600), 0);
  std::string got;
  std::thread reader([&] { got = contents(path("pipe")); });
  write_file_atomically(path("pipe"), std::string_view("through"));
  reader.join();
  EXPECT_EQ(got, "through");
  EXPECT_TRUE(fs::is_fifo(path("pipe")));
}

TEST_F(AtomicFileTest, KeepsSymbolicLinks) {
  write_file_atomically(path("real"), std::string_view("old"));
  fs::create_symlink("real", path("link"));
  write_file_atomically(path("link"), std::string_view("new"));
  EXPECT_TRUE(fs::is_symlink(path("link")));
  EXPECT_EQ(contents(path("real")), "new");
}

TEST_F(AtomicFileTest, ErrorsNameWhyATargetCannotBeWritten) {
  const auto reason = [](const std::string& target) -> std::string {
    try {
      write_file_atomically(target, std::string_view("x"));
    } catch (const OutputError& error) {
      return error.what();
    }
    return "written";
  };
  EXPECT_THAT(reason(path("none/a")), HasSubstr("does not exist"));
  EXPECT_THAT(reason(folder_), HasSubstr("is a folder"));
  EXPECT_THAT(reason(path("a/")), HasSubstr("folder"));
  EXPECT_THAT(reason(""), HasSubstr("no file name"));
  write_file_atomically(path("file"), std::string_view("x"));
  EXPECT_NE(reason(path("file/a")), "written");
  EXPECT_NE(reason(path(std::string(300, 'n'))), "written");
  EXPECT_EQ(reason(path(std::string(250, 'n'))), "written") << "the temporary name is not too long";
}

TEST_F(AtomicFileTest, FoldersAreMadeWithTheirParents) {
  make_folder(path("x/y/z"));
  make_folder(path("x/y/z/"));
  EXPECT_TRUE(fs::is_directory(path("x/y/z")));
  write_file_atomically(path("file"), std::string_view("x"));
  EXPECT_THROW(make_folder(path("file")), OutputError);
  EXPECT_THROW(make_folder(path("file/sub")), OutputError);
  EXPECT_THROW(make_folder(""), OutputError);
}

}  // namespace
}  // namespace tarsier
