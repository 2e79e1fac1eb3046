// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/cache.h"

#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>

#include <string>

namespace tarsier::sfm {
namespace {

using CacheTest = FolderTest;

TEST_F(CacheTest, StoringACheckpointRemovesThoseOfOtherImages) {
  const Cache cache(folder_);
  const std::string first(32, 'a');
  const std::string other(32, 'b');
  const std::string again = first + std::string(Cache::kRemappedSuffix);
  const std::string reevaluated = first + std::string(Cache::kReevaluatedSuffix);
  for (const std::string& key : {first, again, reevaluated}) cache.store(key, MapperState());
  for (const std::string& key : {first, again, reevaluated})
    EXPECT_TRUE(cache.checkpoint(key)) << key;
  cache.store(other, MapperState());
  EXPECT_TRUE(cache.checkpoint(other));
  for (const std::string& key : {first, again, reevaluated})
    EXPECT_FALSE(cache.checkpoint(key)) << key;
}

}  // namespace
}  // namespace tarsier::sfm
