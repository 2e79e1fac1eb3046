// SPDX-License-Identifier: MIT
#include "tarsier/media/part_file.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <sys/stat.h>

namespace tarsier {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

using PartFileTest = FolderTest;

TEST_F(PartFileTest, IsVisibleUntilItReplacesItsEmptyTarget) {
  std::ofstream(path("a.mp4")) << "";
  fs::permissions(path("a.mp4"), fs::perms{0640});
  PartFile file(path("a.mp4"));
  EXPECT_EQ(file.path(), path("a.part.mp4"));
  std::ofstream(file.path()) << "new";
  EXPECT_EQ(contents(path("a.mp4")), "");
  file.commit();
  EXPECT_EQ(contents(path("a.mp4")), "new");
  EXPECT_EQ(fs::status(path("a.mp4")).permissions(), fs::perms{0640});
  EXPECT_EQ(files(), 1U);
}

TEST_F(PartFileTest, KeepsFinishedRecordingsOfItsName) {
  std::ofstream(path("a.mp4")) << "first";
  std::optional<PartFile> second;
  testing::internal::CaptureStderr();
  second.emplace(path("a.mp4"));
  EXPECT_THAT(testing::internal::GetCapturedStderr(),
              AllOf(HasSubstr(path("a.mp4") + ": exists"), HasSubstr(path("a-2.mp4"))));
  PartFile third(path("a.mp4"));
  std::ofstream(second->path()) << "second";
  std::ofstream(third.path()) << "third";
  third.commit();
  second->commit();
  EXPECT_EQ(contents(path("a.mp4")), "first");
  EXPECT_EQ(contents(path("a-2.mp4")), "third");
  EXPECT_EQ(contents(path("a-3.mp4")), "second");
  EXPECT_EQ(files(), 3U);
}

TEST_F(PartFileTest, StaysWithoutCommitUnlessItIsEmpty) {
  {
    const PartFile file(path("a.mp4"));
    std::ofstream(file.path()) << "hours";
  }
  EXPECT_EQ(contents(path("a.part.mp4")), "hours");
  { const PartFile empty(path("b.mp4")); }
  EXPECT_EQ(files(), 1U);
}

TEST_F(PartFileTest, KeepsEarlierPartFilesWithWarning) {
  std::ofstream(path("a.part.mp4")) << "hours";
  std::optional<PartFile> second;
  testing::internal::CaptureStderr();
  second.emplace(path("a.mp4"));
  EXPECT_THAT(testing::internal::GetCapturedStderr(),
              AllOf(HasSubstr(path("a.part.mp4") + ": left by a recording that was cut off"),
                    HasSubstr("rename it")));
  EXPECT_EQ(second->path(), path("a.part-2.mp4"));
  testing::internal::CaptureStderr();
  const PartFile third(path("a.mp4"));
  EXPECT_THAT(testing::internal::GetCapturedStderr(), Not(HasSubstr("part-2")))
      << "that one is being written";
  EXPECT_EQ(third.path(), path("a.part-3.mp4"));
  EXPECT_EQ(contents(path("a.part.mp4")), "hours");
}

TEST_F(PartFileTest, UnwritableTargetIsAnError) {
  EXPECT_THROW(PartFile(path("none/a.mp4")), OutputError);
  EXPECT_THROW(PartFile{folder_}, OutputError);
  EXPECT_THROW(PartFile(""), OutputError);
  EXPECT_THROW(PartFile("/dev/null"), OutputError);
  ASSERT_EQ(::mkfifo(path("pipe.mp4").c_str(), 0600), 0);
  EXPECT_THROW(PartFile(path("pipe.mp4")), OutputError);
}

}  // namespace
}  // namespace tarsier
