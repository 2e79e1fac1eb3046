// SPDX-License-Identifier: MIT
#include "tarsier/face/people/retention.h"

#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>

namespace tarsier::face::people {
namespace {

using RetentionTest = FolderTest;

StoredFace plain_face() {
  StoredFace out;
  out.crop = cv::Mat(40, 32, CV_8UC1, cv::Scalar(90));
  out.measures = "{}";
  return out;
}

constexpr std::int64_t kHour = 3'600'000;

TEST_F(RetentionTest, DeletesOldSightingsEveryHour) {
  Gallery gallery(path("p.db"));
  gallery.enroll("Ann", "", plain_face());
  SightingRetention retention(gallery, 2 * kHour);
  const std::int64_t start = 100 * kHour;
  std::int64_t longest = 0;
  for (std::int64_t now = start; now <= start + 10 * kHour; now += kHour / 4) {
    gallery.add_sighting(now, "camera", "Ann", true, 0.9);
    (void)retention.step(now);
    const auto kept = gallery.sightings();
    longest = std::max(longest, now - kept.back().time);
  }
  EXPECT_LE(longest, 3 * kHour + kHour / 4);
  EXPECT_LE(gallery.sighting_count(), 3 * 4 + 1);
  EXPECT_GE(gallery.sighting_count(), 2 * 4);
}

TEST_F(RetentionTest, DeletesInSmallBatches) {
  Gallery gallery(path("p.db"));
  gallery.enroll("Ann", "", plain_face());
  {
    const DatabaseKind kind{"", 0x54504731, {"", "", "", ""}};
    Database database(path("p.db"), kind, DatabaseAccess::kWrite);
    database.run(
        "WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n WHERE i < 1199) INSERT "
        "INTO sighting(time, source, person, known, confidence) SELECT i, 'camera', 1, 1, 0.9 "
        "FROM n");
  }
  SightingRetention retention(gallery, kHour);
  const std::int64_t now = 100 * kHour;
  EXPECT_EQ(retention.step(now), 500);
  EXPECT_EQ(retention.step(now + 1), 500);
  EXPECT_EQ(retention.step(now + 2), 200);
  EXPECT_EQ(retention.step(now + 3), 0);
  // A clock that is set back does not stop retention.
  gallery.add_sighting(5, "camera", "Ann", true, 0.9);
  EXPECT_EQ(retention.step(now - 50 * kHour), 1);
}

}  // namespace
}  // namespace tarsier::face::people
