// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/workspace.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/scene/testing_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <stdexcept>

namespace tarsier::sfm {
namespace {

using testing::HasSubstr;

std::string error_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

class WorkspaceTest : public FolderTest {
 protected:
  void write_model() {
    Model model = synthetic_model();
    for (geometry::Camera& camera : model.cameras) camera.distortion = {};
    write_colmap(path("sparse"), model);
  }
  [[nodiscard]] Workspace open() const { return Workspace::open(path(".")); }
};

DepthMap small_map() {
  DepthMap map;
  map.depth = cv::Mat1f(48, 64, 2.5F);
  map.normal = cv::Mat3f(48, 64, cv::Vec3f(0, 0.6F, -0.8F));
  map.confidence = cv::Mat1f(48, 64, 0.5F);
  for (int x = 0; x < 64; ++x) map.depth.at<float>(0, x) = 1 + 0.125F * static_cast<float>(x);
  return map;
}

TEST_F(WorkspaceTest, HoldsTheRegisteredImages) {
  write_model();
  const Workspace workspace = open();
  ASSERT_EQ(workspace.count(), 4);
  EXPECT_EQ(workspace.name(1), "folder/photo 2.jpg");
  EXPECT_EQ(workspace.camera(1).width, 800);
  EXPECT_EQ(workspace.pose(1).translation, workspace.sparse().images[1].pose.translation);
  EXPECT_THROW((void)workspace.name(4), std::invalid_argument);
  EXPECT_THROW((void)workspace.pose(-1), std::invalid_argument);
}

TEST_F(WorkspaceTest, MapsRoundTrip) {
  write_model();
  const Workspace workspace = open();
  const DepthMap map = small_map();
  EXPECT_FALSE(workspace.has_depth_map(0));
  workspace.write_depth_map(0, map);
  EXPECT_TRUE(workspace.has_depth_map(0));
  EXPECT_FALSE(workspace.has_depth_map(0, MapKind::kPhotometric));
  const DepthMap read = workspace.read_depth_map(0);
  EXPECT_EQ(cv::norm(read.depth, map.depth, cv::NORM_INF), 0);
  EXPECT_LT(cv::norm(read.normal, map.normal, cv::NORM_INF), 1e-6);
  EXPECT_EQ(cv::norm(read.confidence, map.confidence, cv::NORM_INF), 0);
  EXPECT_EQ(workspace.path_of_map(0, "depth_maps", MapKind::kGeometric),
            path("./stereo/depth_maps/folder/photo 0.jpg.geometric.bin"));
}

TEST_F(WorkspaceTest, MapsOfFlatImagesHaveRoundedSides) {
  Model model = synthetic_model();
  for (geometry::Camera& camera : model.cameras) {
    camera.distortion = {};
    camera.width = 1280;
    camera.height = 162;
  }
  write_colmap(path("sparse"), model);
  DepthMap map;
  map.depth = cv::Mat1f(41, 320, 2.5F);  // 40.5 px
  open().write_depth_map(0, map);
  EXPECT_EQ(open().read_depth_map(0).depth.size(), cv::Size(320, 41));
}

TEST_F(WorkspaceTest, FilesAreThoseOfColmap) {
  write_model();
  const Workspace workspace = open();
  DepthMap map;
  map.depth = (cv::Mat1f(2, 3) << 1, 2, 3, 4, 5, 6);
  map.normal = cv::Mat3f(2, 3, cv::Vec3f(1, 2, 3));
  write_colmap_map(path("depth.bin"), map.depth);
  write_colmap_map(path("normal.bin"), map.normal);
  const std::string depth = read_file(path("depth.bin"), 1000);
  ASSERT_EQ(depth.size(), 6 + 6 * 4U);
  EXPECT_EQ(depth.substr(0, 6), "3&2&1&");
  float second = 0;
  std::memcpy(&second, depth.data() + 10, 4);
  EXPECT_EQ(second, 2);
  const std::string normal = read_file(path("normal.bin"), 1000);
  ASSERT_EQ(normal.size(), 6 + 18 * 4U);
  std::memcpy(&second, normal.data() + 6 + 6 * 4, 4);  // the second channel
  EXPECT_EQ(second, 2);
}

TEST_F(WorkspaceTest, InvalidDepthsAreUnknown) {
  write_model();
  const Workspace workspace = open();
  DepthMap map = small_map();
  map.depth.at<float>(3, 3) = std::numeric_limits<float>::quiet_NaN();
  map.depth.at<float>(3, 4) = -1;
  map.normal.at<cv::Vec3f>(3, 5) = {0, 0, 0};
  workspace.write_depth_map(0, map);
  const DepthMap read = workspace.read_depth_map(0);
  for (int x = 3; x <= 5; ++x) {
    EXPECT_EQ(read.depth.at<float>(3, x), 0);
    EXPECT_EQ(read.confidence.at<float>(3, x), 0);
  }
  EXPECT_EQ(cv::countNonZero(read.depth), 48 * 64 - 3);
}

TEST_F(WorkspaceTest, NormalsAndConfidenceMayBeMissing) {
  write_model();
  const Workspace workspace = open();
  DepthMap map = small_map();
  map.normal.release();
  map.confidence.release();
  workspace.write_depth_map(0, map);
  const DepthMap read = workspace.read_depth_map(0);
  EXPECT_LT(read.normal.at<cv::Vec3f>(24, 32)[2], -0.9F);
  EXPECT_EQ(read.confidence.at<float>(24, 32), 1);
}

TEST_F(WorkspaceTest, ErrorsNameWhatIsMissingOrInvalid) {
  EXPECT_THAT(error_of([&] { (void)Workspace::open(path("none")); }), HasSubstr("is not a folder"));
  EXPECT_THAT(error_of([&] { (void)open(); }), HasSubstr("sparse"));
  write_colmap(path("sparse"), synthetic_model());
  EXPECT_THAT(error_of([&] { (void)open(); }), HasSubstr("distortion"));
  write_model();
  const Workspace workspace = open();
  EXPECT_THAT(error_of([&] { (void)workspace.read_image(0); }), HasSubstr("photo 0.jpg"));
  EXPECT_THAT(error_of([&] { (void)workspace.read_depth_map(0); }), HasSubstr("is missing"));
  workspace.write_depth_map(0, small_map());
  const std::string file = workspace.path_of_map(0, "depth_maps", MapKind::kGeometric);
  const std::string bytes = read_file(file, 1'000'000);
  const auto error_with = [&](const std::string& content) {
    write_file_atomically(file, content);
    return error_of([&] { (void)workspace.read_depth_map(0); });
  };
  EXPECT_THAT(error_with(bytes.substr(0, bytes.size() - 1)), HasSubstr("expected 12288"));
  EXPECT_THAT(error_with("64&48&3&"), HasSubstr("expected 1"));
  EXPECT_THAT(error_with("64&0&1&"), HasSubstr("not a COLMAP map"));
  EXPECT_THAT(error_with("99999999999999999999&1&1&"), HasSubstr("not a COLMAP map"));
  EXPECT_THAT(error_with(""), HasSubstr("not a COLMAP map"));
  EXPECT_THAT(error_with("8&2&1&" + std::string(64, '\0')), HasSubstr("its camera"));
  DepthMap map = small_map();
  map.depth = cv::Mat1f(48, 48, 1.F);
  EXPECT_THROW(workspace.write_depth_map(0, map), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
