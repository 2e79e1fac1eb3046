// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/cloud.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <limits>
#include <stdexcept>

namespace tarsier::sfm {
namespace {

using CloudTest = FolderTest;
using testing::HasSubstr;

std::vector<CloudPoint> some_points(int count) {
  std::vector<CloudPoint> points;
  for (int i = 0; i < count; ++i) {
    const auto f = static_cast<float>(i);
    points.push_back({{f, -2 * f, 0.5F},
                      {0, 0.6F, -0.8F},
                      cv::Vec3b(static_cast<unsigned char>(i), 2, 3),
                      0.25F});
  }
  return points;
}

std::string error_of_reading(const std::string& path) {
  try {
    (void)read_cloud(path);
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

TEST_F(CloudTest, RoundTripsInSeveralParts) {
  const std::vector<CloudPoint> points = some_points(100);
  CloudWriter writer(path("cloud.ply"));
  writer.add(std::span(points).first(30));
  writer.add(std::span(points).subspan(30));
  EXPECT_FALSE(std::filesystem::exists(path("cloud.ply")));
  writer.commit();
  EXPECT_EQ(writer.count(), 100);
  EXPECT_EQ(read_cloud(path("cloud.ply")), points);
}

TEST_F(CloudTest, WithoutCommitThereIsNoFile) {
  {
    CloudWriter writer(path("cloud.ply"));
    writer.add(some_points(3));
  }
  EXPECT_EQ(files(), 0U);
}

TEST_F(CloudTest, RefusesNonFiniteNumbers) {
  CloudWriter writer(path("cloud.ply"));
  std::vector<CloudPoint> points = some_points(1);
  points[0].position[1] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(writer.add(points), std::invalid_argument);
}

TEST_F(CloudTest, ReadsOtherLayouts) {
  std::string bytes =
      "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty uchar red\nproperty double "
      "x\n"
      "property double y\nproperty double z\nproperty short label\nelement face 0\n"
      "property list uchar int vertex_indices\nend_header\n";
  const double numbers[3] = {1, 2, 3};
  bytes.push_back(static_cast<char>(200));
  bytes.append(reinterpret_cast<const char*>(numbers), sizeof numbers);
  bytes.append("ab");
  write_file_atomically(path("other.ply"), bytes);
  const std::vector<CloudPoint> points = read_cloud(path("other.ply"));
  ASSERT_EQ(points.size(), 1U);
  EXPECT_EQ(points[0].position, cv::Vec3f(1, 2, 3));
  EXPECT_EQ(points[0].color, cv::Vec3b(128, 128, 200));
  EXPECT_EQ(points[0].confidence, 1);
}

TEST_F(CloudTest, ErrorsNameTheFault) {
  CloudWriter writer(path("cloud.ply"));
  writer.add(some_points(10));
  writer.commit();
  const std::string bytes = read_file(path("cloud.ply"), 100'000);
  const auto error_with = [&](const std::string& content) {
    write_file_atomically(path("bad.ply"), content);
    return error_of_reading(path("bad.ply"));
  };
  EXPECT_THAT(error_of_reading(path("none.ply")), HasSubstr("cannot be read"));
  EXPECT_THAT(error_with(""), HasSubstr("not a PLY file"));
  EXPECT_THAT(error_with(bytes.substr(0, 100)), HasSubstr("truncated"));
  const std::string long_comment = "comment " + std::string(992, 'x');
  EXPECT_THAT(error_with("ply\n" + long_comment + "\nformat ascii 1.0\n"),
              HasSubstr("binary little-endian"))
      << "1000 bytes in a line";
  EXPECT_THAT(error_with("ply\n" + long_comment + "x\nformat ascii 1.0\n"), HasSubstr("truncated"));
  EXPECT_THAT(error_with(std::string("ply\0\n", 5)), HasSubstr("not a PLY file"));
  EXPECT_THAT(error_with(bytes.substr(0, bytes.size() - 5)), HasSubstr("truncated after 9 of 10"));
  EXPECT_THAT(error_with("ply\nformat ascii 1.0\nelement vertex 0\nend_header\n"),
              HasSubstr("binary little-endian"));
  EXPECT_THAT(error_with("ply\nformat binary_little_endian 1.0\nelement vertex 0\nend_header\n"),
              HasSubstr("no points with x"));
}

}  // namespace
}  // namespace tarsier::sfm
