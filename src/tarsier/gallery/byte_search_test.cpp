// SPDX-License-Identifier: MIT
#include "tarsier/gallery/byte_search.h"

#include "tarsier/core/rng.h"
#include "tarsier/io/atomic_file.h"
#include "tarsier/io/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

namespace tarsier::people {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

std::vector<std::uint8_t> noise(std::size_t size, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<std::uint8_t> out(size);
  for (auto& byte : out) byte = static_cast<std::uint8_t>(rng.integer(0, 255));
  return out;
}

class SearchTest : public FolderTest {
 protected:
  void write(const std::string& name, std::vector<std::uint8_t> bytes) const {
    write_file_atomically(path(name), std::span<const std::uint8_t>(bytes));
  }
};

TEST_F(SearchTest, ThirtyTwoBytesAnywhereAreFound) {
  const auto secret = noise(5000, 1);
  Pieces pieces;
  pieces.add(secret);
  // Also across the seam of two chunks, at odd places, at the very end.
  for (const std::size_t at : {std::size_t{0}, std::size_t{777}, (std::size_t{1} << 20) - 13,
                               std::size_t{3'000'000} - 32}) {
    auto file = noise(3'000'000, 2);
    std::copy(secret.begin() + 1234, secret.begin() + 1234 + 32,
              file.begin() + static_cast<std::ptrdiff_t>(at));
    write("file", file);
    EXPECT_THAT(search_folder(pieces, folder_, {}).found, ElementsAre(path("file"))) << at;
    file[at + 16] ^= 1;
    write("file", file);
    const SearchReport report = search_folder(pieces, folder_, {});
    EXPECT_THAT(report.found, IsEmpty()) << at;
    EXPECT_EQ(report.bytes, 3'000'000);
    EXPECT_THAT(report.files, ElementsAre(path("file")));
  }
}

TEST_F(SearchTest, WhatStaysAndWhatSaysNothingIsNoTrace) {
  auto secret = noise(400, 1);
  const auto common = noise(100, 3);
  secret.insert(secret.end(), common.begin(), common.end());
  const auto between = noise(40, 4);
  secret.insert(secret.end(), between.begin(), between.end());
  secret.insert(secret.end(), 200, 0);
  Pieces pieces;
  pieces.add(secret);
  pieces.keep(common);
  auto file = common;
  file.insert(file.end(), 500, 0);
  write("file", file);
  EXPECT_THAT(search_folder(pieces, folder_, {}).found, IsEmpty());
  write("other", secret);
  EXPECT_THAT(search_folder(pieces, folder_, {}).found, ElementsAre(path("other")));
}

TEST_F(SearchTest, FoldersAndLinksAreLeftAlone) {
  Pieces pieces;
  pieces.add(noise(100, 1));
  make_folder(path("sub"));
  write("sub/file", noise(100, 1));
  std::filesystem::create_symlink("/dev/zero", path("endless"));
  EXPECT_THAT(search_folder(pieces, folder_, {}).files, IsEmpty());
}

}  // namespace
}  // namespace tarsier::people
