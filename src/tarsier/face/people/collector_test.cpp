// SPDX-License-Identifier: MIT
#include "tarsier/face/people/collector.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

namespace tarsier::face::people {
namespace {

Face random_face(int seed) {
  Face out;
  out.crop.create(160, 128, CV_8UC1);
  cv::RNG rng(static_cast<std::uint64_t>(seed) + 1);
  rng.fill(out.crop, cv::RNG::NORMAL, 128, 120);
  cv::GaussianBlur(out.crop, out.crop, {}, 1.5);
  out.eyes = {{40, 40}, {100, 40}};
  out.quality = measure_quality(out.crop, out.eyes, {});
  out.quality.turn = 0;
  return out;
}

TEST(CollectorTest, VideoFacesMustDifferInTimeAndContent) {
  Collector collector;
  EXPECT_EQ(collector.offer(random_face(1), 0, true), "");
  EXPECT_EQ(collector.offer(random_face(2), 0.5, true), "too soon");
  EXPECT_EQ(collector.offer(random_face(1), 1.5, true), "too similar to the last");
  EXPECT_EQ(collector.offer(random_face(2), 1.6, true), "");
  EXPECT_EQ(collector.accepted(), 2);
  EXPECT_EQ(collector.rejected().at("too soon"), 1);
  collector.reset();
  EXPECT_EQ(collector.offer(random_face(2), 1.7, true), "");
}

TEST(CollectorTest, RejectsUncertainFacesIfQualityIsChecked) {
  Face uncertain = random_face(1);
  uncertain.trusted = false;
  Collector strict;
  EXPECT_EQ(strict.offer(uncertain, 0, false), "uncertain face");
  EXPECT_EQ(strict.accepted(), 0);
  CollectOptions any;
  any.check_quality = false;
  EXPECT_EQ(Collector(any).offer(uncertain, 0, false), "");
}

TEST(CollectorTest, AcceptsEachStillImage) {
  Collector collector;
  EXPECT_EQ(collector.offer(random_face(1), 0, false), "");
  EXPECT_EQ(collector.offer(random_face(1), 0, false), "");
}

TEST(CollectorTest, RejectsFacesOfLowQualityIfQualityIsChecked) {
  Face small = random_face(1);
  small.quality.eye_distance = 5;
  Collector strict;
  EXPECT_EQ(strict.offer(small, 0, false), "too small");
  CollectOptions any;
  any.check_quality = false;
  EXPECT_EQ(Collector(any).offer(small, 0, false), "");
}

}  // namespace
}  // namespace tarsier::face::people
