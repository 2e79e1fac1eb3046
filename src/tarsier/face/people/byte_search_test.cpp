// SPDX-License-Identifier: MIT
#include "tarsier/face/people/byte_search.h"

#include "tarsier/core/rng.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

namespace tarsier::face::people {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::vector<std::uint8_t> noise(std::size_t size, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<std::uint8_t> out(size);
  for (auto& byte : out) byte = static_cast<std::uint8_t>(rng.integer(0, 255));
  return out;
}

class SearchBelowTest : public FolderTest {
 protected:
  void write(const std::string& name, std::vector<std::uint8_t> bytes) const {
    write_file_atomically(path(name), std::span<const std::uint8_t>(bytes));
  }
};

TEST_F(SearchBelowTest, FindsPieceAtAnyPosition) {
  const auto secret = noise(5000, 1);
  Pieces pieces;
  pieces.add(secret);
  // Also across the border of two chunks, at odd positions, and at the very end.
  for (const std::size_t at : {std::size_t{0}, std::size_t{777}, (std::size_t{1} << 20) - 13,
                               (std::size_t{1} << 20) - 31, std::size_t{3'000'000} - 32}) {
    auto file = noise(3'000'000, 2);
    std::copy(secret.begin() + 1234, secret.begin() + 1234 + 32,
              file.begin() + static_cast<std::ptrdiff_t>(at));
    write("file", file);
    EXPECT_THAT(search_below(pieces, folder_, {}).files_with_pieces, ElementsAre(path("file")))
        << at;
    file[at + 16] ^= 1;
    write("file", file);
    const SearchReport report = search_below(pieces, folder_, {});
    EXPECT_THAT(report.files_with_pieces, IsEmpty()) << at;
    EXPECT_EQ(report.bytes, 3'000'000);
    EXPECT_THAT(report.files, ElementsAre(path("file")));
  }
}

TEST(PiecesTest, FindsEachPieceAtEachOffset) {
  const auto secret = noise(100, 1);
  Pieces pieces;
  pieces.add(secret);
  EXPECT_EQ(pieces.count(), 69U);
  EXPECT_EQ(pieces.total(), 69);
  for (std::size_t from = 0; from + kPieceBytes <= secret.size(); ++from) {
    for (std::size_t at = 0; at < 9; ++at) {
      std::vector<std::uint8_t> bytes(at, 7);
      bytes.insert(bytes.end(), secret.begin() + static_cast<std::ptrdiff_t>(from),
                   secret.begin() + static_cast<std::ptrdiff_t>(from + kPieceBytes));
      EXPECT_TRUE(pieces.found_in(bytes)) << from << " at " << at;
      bytes.pop_back();
      EXPECT_FALSE(pieces.found_in(bytes)) << from << " at " << at;
    }
  }
}

TEST_F(SearchBelowTest, IgnoresExcludedAndUniformData) {
  auto secret = noise(400, 1);
  const auto common = noise(100, 3);
  secret.insert(secret.end(), common.begin(), common.end());
  const auto between = noise(40, 4);
  secret.insert(secret.end(), between.begin(), between.end());
  secret.insert(secret.end(), 200, 0);
  Pieces pieces;
  pieces.add(secret);
  const std::size_t before = pieces.count();
  EXPECT_EQ(pieces.exclude(common), 69U);
  EXPECT_EQ(pieces.exclude(common), 0U);  // already removed
  EXPECT_EQ(pieces.exclude(noise(5000, 9)), 0U);
  EXPECT_EQ(pieces.count(), before - 69);
  EXPECT_EQ(pieces.excluded(), 69U);
  EXPECT_EQ(pieces.unproven_source_count(), 0U);  // most of this source is still searched for
  auto file = common;
  file.insert(file.end(), 500, 0);
  write("file", file);
  EXPECT_THAT(search_below(pieces, folder_, {}).files_with_pieces, IsEmpty());
  write("other", secret);
  EXPECT_THAT(search_below(pieces, folder_, {}).files_with_pieces, ElementsAre(path("other")));
}

TEST(PiecesTest, CountsSourcesWithTooFewPieces) {
  Pieces pieces;
  pieces.add(noise(400, 1));
  pieces.add(noise(400, 2));
  pieces.add(std::vector<std::uint8_t>(400, 0));  // contains no information
  EXPECT_EQ(pieces.unproven_source_count(), 1U);
  pieces.exclude(noise(400, 2));
  EXPECT_EQ(pieces.unproven_source_count(), 2U);
}

TEST(PiecesTest, SamplesPiecesEvenlyAboveTheLimit) {
  Pieces pieces(1'000'000, 2000);
  for (std::uint64_t i = 0; i < 100; ++i) pieces.add(noise(10'000, i));
  EXPECT_GT(pieces.total(), 900'000);
  EXPECT_LE(pieces.count(), 2000U + 100);
  EXPECT_GE(pieces.count(), 1800U);
  // A whole copy of any source is found at any position.
  for (std::uint64_t i = 0; i < 100; ++i) {
    std::vector<std::uint8_t> file(i, 7);
    const auto one = noise(10'000, i);
    file.insert(file.end(), one.begin(), one.end());
    EXPECT_TRUE(pieces.found_in(file)) << i;
  }
  EXPECT_FALSE(pieces.found_in(noise(1'000'000, 777)));
}

TEST_F(SearchBelowTest, SearchesSubfoldersAndReportsLinksAndSkippedFolders) {
  Pieces pieces;
  pieces.add(noise(100, 1));
  make_folder(path("sub"));
  make_folder(path("sub/deeper"));
  write("sub/deeper/file", noise(100, 1));
  write("sub/other", noise(100, 2));
  write("own", noise(100, 3));
  std::filesystem::create_symlink("/dev/zero", path("endless"));
  std::filesystem::create_directory_symlink(folder_, path("sub/round"));
  SearchReport report = search_below(pieces, folder_, {});
  EXPECT_THAT(report.files, ElementsAre(path("own"), path("sub/other"), path("sub/deeper/file")));
  EXPECT_THAT(report.files_with_pieces, ElementsAre(path("sub/deeper/file")));
  EXPECT_EQ(report.links, 2);
  EXPECT_EQ(report.folders, 3);
  EXPECT_THAT(report.skipped, IsEmpty());
  SearchLimits limits;
  limits.max_depth = 1;
  report = search_below(pieces, folder_, {}, limits);
  EXPECT_THAT(report.files_with_pieces, IsEmpty());
  EXPECT_THAT(report.skipped, ElementsAre(HasSubstr("sub/deeper: too many folders")));
  limits = {};
  limits.max_files = 1;  // the folder's own files are always searched
  report = search_below(pieces, folder_, {}, limits);
  EXPECT_THAT(report.files, ElementsAre(path("own")));
  EXPECT_THAT(report.skipped, ElementsAre(HasSubstr("sub: more than")));
}

}  // namespace
}  // namespace tarsier::face::people
