// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/colmap_database.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/media/sqlite.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/pipelines/known_features.h"
#include "tarsier/sfm/pipelines/testing_colmap_database.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <limits>

namespace tarsier::sfm {
namespace {

using ::testing::HasSubstr;

ColmapDatabase drawn() {
  ColmapDatabase database;
  geometry::Camera camera{640, 480, 500, 510, 319.5, 239.5, {-0.1, 0.01, 0, 0, 0}, 0};
  database.cameras = {{camera, true}, {camera, false}};
  database.cameras[1].camera.distortion = {};
  Rng rng(1);
  for (int i = 0; i < 3; ++i) {
    ColmapDatabase::DatabaseImage image;
    image.name = "photo " + std::to_string(i) + ".jpg";
    image.camera = i == 2 ? 1 : 0;
    image.features.descriptors.create(50, 128, CV_8UC1);
    for (int f = 0; f < 50; ++f) {
      image.features.points.emplace_back(static_cast<float>(rng.uniform(0, 640)),
                                         static_cast<float>(rng.uniform(0, 480)));
      image.features.sizes.push_back(static_cast<float>(rng.uniform(2, 30)));
      for (int k = 0; k < 128; ++k)
        image.features.descriptors.at<std::uint8_t>(f, k) =
            static_cast<std::uint8_t>(rng.integer(0, 255));
    }
    database.images.push_back(std::move(image));
  }
  ColmapDatabase::DatabasePair pair;
  pair.first = 0;
  pair.second = 2;
  pair.matches = {{0, 3}, {7, 49}, {49, 0}};
  pair.view.second_from_first.translation = {0, 0, 1};
  database.pairs = {pair};
  return database;
}

TEST(ColmapDatabase, RoundTripKeepsContent) {
  const TemporaryFolder folder;
  const ColmapDatabase written = drawn();
  write_colmap_database(folder / "database.db", written);
  const ColmapDatabase read = read_colmap_database(folder / "database.db");
  ASSERT_EQ(read.cameras.size(), 2U);
  EXPECT_EQ(read.cameras[0].camera.matrix(), written.cameras[0].camera.matrix());
  EXPECT_EQ(read.cameras[0].camera.distortion, written.cameras[0].camera.distortion);
  EXPECT_TRUE(read.cameras[0].is_focal_known);
  EXPECT_FALSE(read.cameras[1].is_focal_known);
  ASSERT_EQ(read.images.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    const Features& a = written.images[i].features;
    const Features& b = read.images[i].features;
    EXPECT_EQ(read.images[i].name, written.images[i].name);
    EXPECT_EQ(read.images[i].camera, written.images[i].camera);
    ASSERT_EQ(a.points.size(), b.points.size());
    for (std::size_t f = 0; f < a.points.size(); ++f) {
      EXPECT_LT(cv::norm(a.points[f] - b.points[f]), 1e-4);
      EXPECT_FLOAT_EQ(a.sizes[f], b.sizes[f]);
    }
    EXPECT_EQ(cv::norm(a.descriptors, b.descriptors, cv::NORM_INF), 0);
  }
  ASSERT_EQ(read.pairs.size(), 1U);
  EXPECT_EQ(read.pairs[0].first, 0);
  EXPECT_EQ(read.pairs[0].second, 2);
  EXPECT_EQ(read.pairs[0].matches, written.pairs[0].matches);
}

// COLMAP makes a camera for each image by default.
TEST(ColmapDatabase, CamerasOfOneImageAreSharedWhereTheyAreEqual) {
  const TemporaryFolder folder;
  const auto cameras_of = [&](const ColmapDatabase& database) {
    write_colmap_database(folder / "database.db", database);
    KnownFeatures known(folder / "database.db");
    ImageSet set(PipelineOptions{});
    std::vector<int> cameras;
    for (const auto& image : database.images) {
      ImageFeatures features;
      known.fill({image.name, ""}, cv::Mat(), features, PipelineOptions{});
      set.add(features, image.name);
      cameras.push_back(set.images().back().camera);
    }
    return cameras;
  };
  ColmapDatabase database = drawn();
  const auto guessed = database.cameras[1];
  database.cameras = {guessed, guessed, guessed};
  for (int i = 0; i < 3; ++i) database.images[static_cast<std::size_t>(i)].camera = i;
  EXPECT_EQ(cameras_of(database), (std::vector<int>{0, 0, 0}));
  // The same focal length, another principal point.
  database.cameras[1].camera.cx += 20;
  EXPECT_EQ(cameras_of(database), (std::vector<int>{0, 1, 0}));
  // The database says which images share a camera.
  database.cameras[1] = guessed;
  database.images[1].camera = 0;
  EXPECT_EQ(cameras_of(database), (std::vector<int>{0, 0, 1}));
}

TEST(ColmapDatabase, ReplacesExistingFile) {
  const TemporaryFolder folder;
  ColmapDatabase database = drawn();
  write_colmap_database(folder / "database.db", database);
  database.pairs.clear();
  write_colmap_database(folder / "database.db", database);
  EXPECT_TRUE(read_colmap_database(folder / "database.db").pairs.empty());
}

// Writes drawn() and changes it.
void write_changed(const std::string& path, const std::string& statements) {
  write_colmap_database(path, drawn());
  Database file(path, test_support::colmap_database_kind(), DatabaseAccess::kWrite);
  file.run("PRAGMA foreign_keys = OFF");
  file.run(statements);
}

// The error for a database after these statements.
std::string error_after(const std::string& statements) {
  const TemporaryFolder folder;
  write_changed(folder / "database.db", statements);
  try {
    (void)read_colmap_database(folder / "database.db");
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

// What COLMAP 4 adds.
const char* const kVersion4 =
    "CREATE TABLE rigs (rig_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, ref_sensor_id INTEGER "
    "NOT NULL, ref_sensor_type INTEGER NOT NULL);"
    "CREATE TABLE frames (frame_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, rig_id INTEGER NOT "
    "NULL, FOREIGN KEY(rig_id) REFERENCES rigs(rig_id) ON DELETE CASCADE);"
    "CREATE TABLE frame_data (frame_id INTEGER NOT NULL, data_id INTEGER NOT NULL, sensor_id "
    "INTEGER NOT NULL, sensor_type INTEGER NOT NULL);"
    "CREATE TABLE pose_priors (pose_prior_id INTEGER PRIMARY KEY NOT NULL, corr_data_id INTEGER "
    "NOT NULL, corr_sensor_id INTEGER NOT NULL, corr_sensor_type INTEGER NOT NULL, position BLOB, "
    "position_covariance BLOB, gravity BLOB, coordinate_system INTEGER NOT NULL);"
    "CREATE UNIQUE INDEX pose_prior_data_assignment ON pose_priors(corr_data_id, corr_sensor_id, "
    "corr_sensor_type);"
    "INSERT INTO rigs VALUES (1, 1, 0), (2, 2, 0);"
    "INSERT INTO frames VALUES (1, 1), (2, 1), (3, 2);"
    "INSERT INTO frame_data VALUES (1, 1, 1, 0), (2, 2, 1, 0), (3, 3, 2, 0);"
    "ALTER TABLE descriptors RENAME TO old;"
    "CREATE TABLE descriptors (image_id INTEGER PRIMARY KEY NOT NULL, type INTEGER NOT NULL, rows "
    "INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB);"
    "INSERT INTO descriptors SELECT image_id, 0, rows, cols, data FROM old;"
    "DROP TABLE old;"
    "ALTER TABLE images DROP COLUMN prior_qw;"
    "PRAGMA user_version = 4010;";

TEST(ColmapDatabase, ReadsVersion4) {
  const TemporaryFolder folder;
  write_changed(folder / "database.db", kVersion4);
  const ColmapDatabase read = read_colmap_database(folder / "database.db");
  const ColmapDatabase written = drawn();
  ASSERT_EQ(read.images.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_EQ(cv::norm(written.images[i].features.descriptors, read.images[i].features.descriptors,
                       cv::NORM_INF),
              0);
  ASSERT_EQ(read.pairs.size(), 1U);
  EXPECT_EQ(read.pairs[0].matches, written.pairs[0].matches);
}

TEST(ColmapDatabase, LeavesOutDescriptorsOtherThanSift) {
  const TemporaryFolder folder;
  write_changed(folder / "database.db",
                std::string(kVersion4) +
                    "UPDATE descriptors SET type = 1, cols = 512, data = zeroblob(25600) WHERE "
                    "image_id = 1");
  const ColmapDatabase read = read_colmap_database(folder / "database.db");
  EXPECT_TRUE(read.images[0].features.descriptors.empty());
  EXPECT_EQ(read.images[0].features.points.size(), 50U);
  EXPECT_EQ(read.images[1].features.descriptors.rows, 50);
  EXPECT_EQ(read.pairs.size(), 1U);
}

// The pose priors of COLMAP 3.11.
const char* const kPriors3 =
    "CREATE TABLE pose_priors (image_id INTEGER PRIMARY KEY NOT NULL, position BLOB, "
    "coordinate_system INTEGER NOT NULL, position_covariance BLOB, FOREIGN KEY(image_id) "
    "REFERENCES images(image_id) ON DELETE CASCADE);";

// Three doubles as a blob of SQL.
std::string blob(double x, double y, double z) {
  const std::array<double, 3> numbers{x, y, z};
  std::array<unsigned char, sizeof(numbers)> bytes{};
  std::memcpy(bytes.data(), numbers.data(), sizeof(numbers));
  std::string text = "x'";
  for (const unsigned char byte : bytes) text += fmt::format("{:02x}", byte);
  return text + "'";
}

std::vector<ColmapPosePrior> priors_after(const std::string& statements) {
  const TemporaryFolder folder;
  write_changed(folder / "database.db", statements);
  return read_colmap_pose_priors(folder / "database.db");
}

std::string prior_error_after(const std::string& statements) {
  try {
    (void)priors_after(statements);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

// Of version 3.11: an image's prior.
std::string prior(int image, const std::string& position, int system) {
  return fmt::format("INSERT INTO pose_priors VALUES ({}, {}, {}, NULL);", image, position, system);
}

TEST(ColmapDatabase, ReadsPosePriorsOfVersions3And4) {
  EXPECT_TRUE(priors_after("SELECT 1").empty());  // no table
  EXPECT_TRUE(priors_after(kPriors3).empty());
  const auto check = [](const std::vector<ColmapPosePrior>& priors) {
    ASSERT_EQ(priors.size(), 2U);
    EXPECT_EQ(priors[0].name, "photo 0.jpg");
    EXPECT_EQ(priors[0].position, Eigen::Vector3d(47, 8, 400));
    EXPECT_TRUE(priors[0].is_wgs84);
    EXPECT_EQ(priors[1].name, "photo 2.jpg");
    EXPECT_EQ(priors[1].position, Eigen::Vector3d(-1, 2, 3));
    EXPECT_FALSE(priors[1].is_wgs84);
  };
  check(priors_after(kPriors3 + prior(3, blob(-1, 2, 3), 1) + prior(1, blob(47, 8, 400), 0)));
  // The first form has no covariance.
  check(priors_after(kPriors3 + prior(3, blob(-1, 2, 3), 1) + prior(1, blob(47, 8, 400), 0) +
                     "ALTER TABLE pose_priors DROP COLUMN position_covariance"));
  // The ids of priors are not those of images. Another sensor may have the id of an image.
  check(priors_after(kVersion4 + std::string("INSERT INTO pose_priors VALUES (9, 3, 2, 0, ") +
                     blob(-1, 2, 3) + ", zeroblob(72), zeroblob(24), 1), (2, 1, 1, 0, " +
                     blob(47, 8, 400) + ", NULL, NULL, 0), (3, 2, 1, 1, " + blob(5, 5, 5) +
                     ", NULL, NULL, 1)"));
}

TEST(ColmapDatabase, LeavesOutPosePriorsWithoutPosition) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  EXPECT_TRUE(priors_after(kPriors3 + prior(1, "NULL", 0) + prior(2, blob(kNan, kNan, kNan), 0) +
                           prior(3, blob(0, 0, 7), 0))
                  .empty());
  EXPECT_TRUE(priors_after(kPriors3 + prior(1, blob(91, 8, 0), 0) + prior(2, blob(47, 361, 0), 0) +
                           prior(3, blob(47, 8, 1e300), 0))
                  .empty());
  EXPECT_TRUE(priors_after(kPriors3 + prior(1, blob(kNan, 8, 0), 0) +
                           prior(2, blob(1, kInfinity, 0), 1) + prior(3, blob(1, 2, kNan), 1))
                  .empty());
  EXPECT_TRUE(priors_after(kPriors3 + prior(1, blob(1, 2, 3), 2) + prior(2, blob(1, 2, 3), -2) +
                           prior(3, blob(1, -1e13, 3), -1))
                  .empty());
  // An unknown altitude; no coordinate system.
  const auto priors =
      priors_after(kPriors3 + prior(1, blob(47, 8, kNan), 0) + prior(2, blob(1, 2, 3), -1));
  ASSERT_EQ(priors.size(), 2U);
  EXPECT_EQ(priors[0].position, Eigen::Vector3d(47, 8, 0));
  EXPECT_FALSE(priors[1].is_wgs84);
}

TEST(ColmapDatabase, RefusesInconsistentPosePriors) {
  EXPECT_THAT(prior_error_after(kPriors3 + prior(1, "zeroblob(23)", 0)),
              HasSubstr("pose prior of image 1: 23 bytes for 3 numbers"));
  EXPECT_THAT(prior_error_after(kPriors3 + prior(1, "'text'", 1)), HasSubstr("4 bytes"));
  EXPECT_THAT(prior_error_after(kPriors3 + prior(7, blob(1, 2, 3), 1)),
              HasSubstr("pose prior of image 7"));
  EXPECT_THAT(prior_error_after("CREATE TABLE pose_priors (position BLOB)"), HasSubstr("image_id"));
  // Models do not depend on them.
  EXPECT_EQ(error_after(kPriors3 + prior(1, "zeroblob(23)", 0)), "");
}

TEST(ColmapDatabase, RefusesInconsistentTables) {
  EXPECT_EQ(error_after("SELECT 1"), "");
  EXPECT_THAT(error_after("DROP TABLE keypoints"), HasSubstr("keypoints"));
  EXPECT_THAT(error_after("UPDATE keypoints SET rows = 51 WHERE image_id = 1"),
              HasSubstr("keypoints"));
  EXPECT_THAT(error_after("UPDATE keypoints SET rows = -1"), HasSubstr("keypoints"));
  EXPECT_THAT(error_after("UPDATE keypoints SET cols = 3"), HasSubstr("3 columns"));
  EXPECT_THAT(error_after("UPDATE keypoints SET data = zeroblob(800)"), HasSubstr("size"));
  EXPECT_THAT(error_after("UPDATE descriptors SET rows = 49"), HasSubstr("descriptors"));
  EXPECT_THAT(error_after("UPDATE images SET camera_id = 9"), HasSubstr("camera"));
  EXPECT_THAT(error_after("UPDATE images SET name = '../etc' WHERE image_id = 1"),
              HasSubstr("refers to a file outside the folder"));
  EXPECT_THAT(error_after("UPDATE cameras SET model = 77"), HasSubstr("model"));
  EXPECT_THAT(error_after("UPDATE cameras SET params = zeroblob(7)"), HasSubstr("7 bytes"));
  EXPECT_THAT(error_after("UPDATE two_view_geometries SET pair_id = 5"), HasSubstr("unknown"));
  EXPECT_THAT(error_after("UPDATE two_view_geometries SET data = x'"
                          "ffffffff00000000ffffffff00000000ffffffff00000000'"),
              HasSubstr("does not exist"));
}

TEST(ColmapDatabase, RefusesFilesThatAreNoDatabase) {
  const TemporaryFolder folder;
  EXPECT_THROW((void)read_colmap_database(folder / "none.db"), InputError);
  std::ofstream(folder / "text.db") << "no database at all, but some text";
  EXPECT_THROW((void)read_colmap_database(folder / "text.db"), InputError);
  std::ofstream(folder / "empty.db");
  EXPECT_THROW((void)read_colmap_database(folder / "empty.db"), InputError);
  ColmapDatabase database = drawn();
  database.images[1].name = database.images[0].name;
  EXPECT_THROW(write_colmap_database(folder / "twice.db", database), std::invalid_argument);
  EXPECT_FALSE(std::filesystem::exists(folder / "twice.db"));
}

}  // namespace
}  // namespace tarsier::sfm
