// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/mapped_store.h"

#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace tarsier::sfm {
namespace {

cv::Mat drawn(int rows, std::uint64_t seed) {
  cv::Mat result(rows, 128, CV_8UC1);
  cv::RNG rng(seed);
  if (rows > 0) rng.fill(result, cv::RNG::UNIFORM, 0, 256);
  return result;
}

bool are_equal(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && (a.empty() || cv::norm(a, b, cv::NORM_INF) == 0);
}

TEST(MappedStore, ReadsBackReleasedData) {
  const TemporaryFolder folder;
  MappedStore store(folder.path());
  std::vector<cv::Mat> given;
  std::vector<cv::Mat> kept;
  // The second matrix is larger than a mapped part of the file. One has no descriptors; one is part
  // of a matrix.
  const int rows[] = {100, 600'000, 0, 33, 5000};
  for (const int count : rows) {
    given.push_back(drawn(count, static_cast<std::uint64_t>(count)));
    kept.push_back(store.add(given.back()));
  }
  given.push_back(drawn(50, 7).colRange(0, 32));
  kept.push_back(store.add(given.back()));
  for (int times = 0; times < 2; ++times) {
    for (std::size_t k = 0; k < given.size(); ++k) EXPECT_TRUE(are_equal(kept[k], given[k])) << k;
    store.trim();
  }
  EXPECT_NE(kept[0].data, given[0].data);
  EXPECT_GE(store.bytes(), std::size_t{605'133} * 128);
}

TEST(MappedStore, MatchesOutliveTheStore) {
  const TemporaryFolder folder;
  MatchList kept;
  const MatchList given{{1, 2}, {3, 4}, {500, 60}};
  {
    MappedStore store(folder.path());
    EXPECT_TRUE(store.add(MatchList()).empty());
    (void)store.add(drawn(10, 1));
    kept = store.add(given);
    store.trim();
  }
  EXPECT_NE(kept.data(), given.data());
  EXPECT_EQ(kept, given);
}

TEST(MappedStore, WarnsOnceAboveMemoryLimit) {
  const TemporaryFolder folder;
  MappedStore store(folder.path(), 1000);
  (void)store.add(drawn(10, 1));
  ::testing::internal::CaptureStderr();
  store.trim();
  store.trim();
  const std::string output = ::testing::internal::GetCapturedStderr();
  EXPECT_NE(output.find("memory limit"), std::string::npos) << output;
  EXPECT_EQ(output.find("memory limit"), output.rfind("memory limit")) << output;
}

TEST(MappedStore, LeavesNoFileBehind) {
  const TemporaryFolder folder;
  MappedStore store(folder.path());
  (void)store.add(drawn(100, 1));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(MappedStore, KeepsDataInMemoryWhereFolderIsNotWritable) {
  const cv::Mat given = drawn(100, 1);
  MappedStore without("");
  EXPECT_EQ(without.add(given).data, given.data);
  const TemporaryFolder folder;
  MappedStore missing(folder.path() + "/missing");
  EXPECT_EQ(missing.add(given).data, given.data);
  EXPECT_EQ(missing.add(given).data, given.data);
}

}  // namespace
}  // namespace tarsier::sfm
