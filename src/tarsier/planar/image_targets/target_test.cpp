// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/media/archive.h"
#include "tarsier/planar/image_targets/detect.h"
#include "tarsier/planar/image_targets/quality.h"
#include "tarsier/planar/image_targets/target_io.h"
#include "tarsier/planar/image_targets/testing_corners.h"
#include "tarsier/planar/image_targets/train.h"
#include "tarsier/synth/planar_images.h"
#include "tarsier/synth/planar_source.h"
#include "tarsier/synth/planar_worlds.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tarsier::planar::image_targets {
namespace {

// Trained once for all tests.
const Target& poster() {
  static const Target target = [] {
    TrainOptions options;
    options.trials = 8;
    return train_target(synth::poster_print(0, 5).image, "poster", options);
  }();
  return target;
}

synth::PlanarStill still(synth::PlanarLevel level, std::uint64_t seed, double hidden = 0) {
  synth::StillOptions options;
  options.max_prints = 1;
  options.min_side_px = 100;
  options.max_side_px = 280;
  options.tilt_deg = 55;
  options.hidden_share = hidden;
  return synth::print_still({synth::poster_print(0, 5)}, options, level, seed);
}

TEST(Target, IsDetectedWithSubpixelAccuracy) {
  int found = 0;
  int shown = 0;
  std::vector<double> errors;
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    const synth::PlanarStill s = still(synth::PlanarLevel::kMedium, seed);
    if (s.truth.empty()) continue;
    ++shown;
    const auto seen = detect_targets({poster()}, s.image, {}, &s.camera);
    if (seen.empty()) continue;
    const double error = corner_rms(seen[0].corners, s.truth[0].corners);
    EXPECT_LT(error, 3) << "seed " << seed;
    errors.push_back(error);
    ++found;
    ASSERT_TRUE(seen[0].poses.has_value());
    const geometry::Rigid3& pose = seen[0].poses->best.camera_from_plane;
    EXPECT_LT(geometry::angle_of(pose.rotation * s.truth[0].camera_from_print.rotation.transpose()),
              0.05)
        << "seed " << seed;
    EXPECT_LT((pose.translation - s.truth[0].camera_from_print.translation).norm(),
              0.02 * s.truth[0].camera_from_print.translation.norm())
        << "seed " << seed;
  }
  ASSERT_GE(shown, 8);
  EXPECT_GE(found, shown - 1);
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], 0.5);
}

TEST(Target, IsDetectedWhenPartlyOccluded) {
  int found = 0;
  int shown = 0;
  for (std::uint64_t seed = 30; seed < 40; ++seed) {
    const synth::PlanarStill s = still(synth::PlanarLevel::kEasy, seed, 1);
    if (s.truth.empty() || s.truth[0].visible < 0.55) continue;
    ++shown;
    const auto seen = detect_targets({poster()}, s.image);
    if (!seen.empty() && corner_rms(seen[0].corners, s.truth[0].corners) < 3) ++found;
  }
  ASSERT_GE(shown, 4);
  EXPECT_GE(found, shown - 1);
}

TEST(Target, HasNoFalseDetections) {
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    EXPECT_TRUE(detect_targets({poster()}, synth::clutter_image(640, seed)).empty()) << seed;
    // Another poster in the same style.
    const cv::Mat other = synth::poster_print(1, 77 + seed).image;
    EXPECT_TRUE(detect_targets({poster()}, other).empty()) << seed;
  }
}

TEST(Target, IsNotDetectedWhenMirrored) {
  cv::Mat mirrored;
  cv::flip(synth::poster_print(0, 5).image, mirrored, 1);
  EXPECT_TRUE(detect_targets({poster()}, mirrored).empty());
  EXPECT_FALSE(detect_targets({poster()}, synth::poster_print(0, 5).image).empty());
}

TEST(Target, DetectionIsDeterministic) {
  const synth::PlanarStill s = still(synth::PlanarLevel::kMedium, 3);
  const auto a = detect_targets({poster()}, s.image);
  const auto b = detect_targets({poster()}, s.image);
  ASSERT_EQ(a.size(), b.size());
  ASSERT_EQ(a.size(), 1U);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(a[0].corners[i], b[0].corners[i]);
}

TEST(Target, IsNotDetectedInTinyOrUniformFrames) {
  EXPECT_TRUE(detect_targets({poster()}, cv::Mat(8, 8, CV_8UC1, cv::Scalar(90))).empty());
  EXPECT_TRUE(detect_targets({poster()}, cv::Mat(480, 640, CV_8UC3, cv::Scalar::all(0))).empty());
  EXPECT_THROW((void)detect_targets({poster()}, cv::Mat()), std::invalid_argument);
}

TEST(TargetQuality, SeparatesGoodFromPoorImages) {
  EXPECT_GT(poster().quality.rating, 0.6);
  EXPECT_TRUE(poster().quality.reasons.empty());
  TrainOptions options;
  options.trials = 6;
  const Target flat = train_target(cv::Mat(300, 400, CV_8UC1, cv::Scalar(128)), "flat", options);
  EXPECT_EQ(flat.quality.rating, 0);
  EXPECT_THAT(flat.quality.reasons, testing::Contains(testing::HasSubstr("few features")));
  // The same tile repeated: many features, but each equals its copies.
  cv::Mat tile;
  cv::resize(synth::poster_image({120, 90}, 4), tile, {60, 45}, 0, 0, cv::INTER_AREA);
  cv::Mat wall;
  cv::repeat(tile, 7, 7, wall);
  const Target repeated = train_target(wall, "wall", options);
  EXPECT_LT(repeated.quality.rating, 0.4);
  EXPECT_THAT(repeated.quality.reasons, testing::Contains(testing::HasSubstr("repetitive")));
  const cv::Mat drawn = draw_quality(repeated);
  EXPECT_EQ(drawn.type(), CV_8UC3);
  EXPECT_GT(drawn.rows, wall.rows);
}

TEST(TargetTraining, RejectsInvalidImages) {
  EXPECT_THROW((void)train_target(cv::Mat(), "x"), std::invalid_argument);
  EXPECT_THROW((void)train_target(cv::Mat(20, 200, CV_8UC1), "x"), std::invalid_argument);
  EXPECT_THROW((void)train_target(cv::Mat(40, 400, CV_8UC1), "x"), std::invalid_argument);
  TrainOptions options;
  options.width = 0;
  EXPECT_THROW((void)train_target(cv::Mat(200, 200, CV_8UC1), "x", options), std::invalid_argument);
}

class TargetFile : public testing::Test {
 protected:
  void SetUp() override {
    path_ =
        (std::filesystem::temp_directory_path() /
         ("tarsier_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) +
          ".target.json"))
            .string();
    write_target(path_, poster());
  }
  void TearDown() override { std::filesystem::remove(path_); }
  [[nodiscard]] nlohmann::json content() const {
    std::ifstream file(path_);
    return nlohmann::json::parse(file);
  }
  void write(const std::string& text) const { std::ofstream(path_) << text; }
  std::string path_;
};

TEST_F(TargetFile, RoundTripsTarget) {
  const Target back = read_target(path_);
  EXPECT_EQ(back.name, poster().name);
  EXPECT_EQ(back.width, poster().width);
  EXPECT_EQ(back.height, poster().height);
  EXPECT_EQ(back.quality.rating, poster().quality.rating);
  const synth::PlanarStill s = still(synth::PlanarLevel::kMedium, 2);
  const auto a = detect_targets({poster()}, s.image);
  const auto b = detect_targets({back}, s.image);
  ASSERT_EQ(a.size(), 1U);
  ASSERT_EQ(b.size(), 1U);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(a[0].corners[i], b[0].corners[i]);
}

TEST_F(TargetFile, IsRejectedWhenDamaged) {
  const nlohmann::json good = content();
  const auto refused = [&](auto&& spoil) {
    nlohmann::json bad = good;
    spoil(bad);
    write(bad.dump());
    EXPECT_THROW((void)read_target(path_), ModelError);
  };
  refused([](nlohmann::json& j) { j["type"] = "shape-model"; });
  refused([](nlohmann::json& j) { j["version"] = 2; });
  refused([](nlohmann::json& j) { j["payload"].erase("points"); });
  refused([](nlohmann::json& j) { j["payload"]["width"] = -1; });
  refused([](nlohmann::json& j) { j["payload"]["height"] = 40; });
  refused([](nlohmann::json& j) { j["payload"]["given"] = {600}; });
  refused([](nlohmann::json& j) { j["payload"]["given"] = {"a", 3}; });
  refused([](nlohmann::json& j) { j["payload"]["quality"]["rating"] = 7; });
  refused([](nlohmann::json& j) { j["payload"]["image"]["shape"] = {2, 2}; });
  refused([](nlohmann::json& j) { j["payload"]["frames"] = j["payload"]["points"]; });
  refused([](nlohmann::json& j) { j["payload"]["right"]["shape"] = {1}; });
  // The points belong to a wider image and lie outside this one.
  refused([](nlohmann::json& j) {
    j["payload"]["image"] = pack(PackedArray<std::uint8_t>{{8, 12}, std::vector<std::uint8_t>(96)});
  });
  write(good.dump().substr(0, 5000));
  EXPECT_THROW((void)read_target(path_), ModelError);
  EXPECT_THROW((void)read_target("/nowhere/x.target.json"), ModelError);
}

}  // namespace
}  // namespace tarsier::planar::image_targets
