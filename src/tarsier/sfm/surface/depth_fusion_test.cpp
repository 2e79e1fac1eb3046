// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/depth_fusion.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/surface/dark_background.h"
#include "tarsier/sfm/surface/extraction.h"
#include "tarsier/sfm/surface/refinement.h"
#include "tarsier/sfm/surface/surface_mesh.h"
#include "tarsier/sfm/surface/testing_surface.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <filesystem>
#include <map>
#include <set>
#include <stdexcept>

namespace tarsier::sfm {
namespace {

using testing::HasSubstr;

SurfaceMesh surface_of(const std::string& folder, const VolumeOptions& options,
                       double* voxel = nullptr) {
  NoProgress progress;
  const FusedVolume fused = fuse_depth_maps(Workspace::open(folder), options, progress, {});
  if (voxel != nullptr) *voxel = fused.volume.size();
  SurfaceMesh mesh = extract_surface(fused.volume, options.truncation);
  remove_small_parts(mesh, 0.02);
  close_holes(mesh, 6 * fused.volume.size());
  mesh.check();
  return mesh;
}

std::string error_of(const std::string& folder, const VolumeOptions& options,
                     const std::stop_token& stop = {}) {
  try {
    NoProgress progress;
    (void)fuse_depth_maps(Workspace::open(folder), options, progress, stop);
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

class DepthFusionTest : public FolderTest {};

TEST(CellTriangles, GiveAClosedManifoldForAnyPatternOfSigns) {
  // Any pattern of signs on a closed grid gives a surface with two faces at every edge.
  VoxelVolume volume(1);
  volume.allocate({VoxelVolume::key_of({0, 0, 0})});
  std::uint32_t state = 12345;
  for (int round = 0; round < 40; ++round) {
    auto voxels = volume.voxels(0);
    for (int z = 0; z < 8; ++z) {
      for (int y = 0; y < 8; ++y) {
        for (int x = 0; x < 8; ++x) {
          state = state * 1664525 + 1013904223;
          const bool outer = std::min({x, y, z}) == 0 || std::max({x, y, z}) == 7;
          const float distance = outer || state >> 31 != 0 ? 0.7F : -0.4F;
          voxels[static_cast<std::size_t>(x + 8 * (y + 8 * z))] = {distance, 1};
        }
      }
    }
    const SurfaceMesh mesh = extract_surface(volume, 4);
    ASSERT_FALSE(mesh.faces.empty());
    std::map<std::pair<int, int>, int> directed;
    for (const Face& face : mesh.faces)
      for (std::size_t k = 0; k < 3; ++k) ++directed[{face[k], face[(k + 1) % 3]}];
    for (const auto& [edge, count] : directed) {
      EXPECT_EQ(count, 1);
      EXPECT_TRUE(directed.contains({edge.second, edge.first}));
    }
    const SurfaceMeasures measures = measure_surface(mesh);
    EXPECT_TRUE(measures.is_closed());
    EXPECT_GT(measures.volume.value_or(-1), 0);
  }
}

TEST_F(DepthFusionTest, ASphereIsClosedAndAccurate) {
  const Eigen::Vector3d center(0.1, -0.05, 0.2);
  write_workspace(folder_, sphere_caster(center, 1), test_camera(), cameras_all_around(24, 4));
  double voxel = 0;
  const SurfaceMesh mesh = surface_of(folder_, {}, &voxel);
  EXPECT_NEAR(voxel, 1.5 * 3.2 / 150, 0.005);
  const SurfaceMeasures measures = measure_surface(mesh);
  EXPECT_EQ(measures.parts, 1);
  EXPECT_EQ(measures.holes, 0);
  EXPECT_EQ(measures.euler(), 2);
  const double truth = 4.0 / 3 * std::numbers::pi;
  EXPECT_NEAR(measures.volume.value_or(0), truth, 0.01 * truth);
  EXPECT_NEAR(measures.area, 4 * std::numbers::pi, 0.02 * 4 * std::numbers::pi);
  double max_error = 0;
  for (const Eigen::Vector3f& v : mesh.vertices)
    max_error = std::max(max_error, std::abs((v.cast<double>() - center).norm() - 1));
  EXPECT_LT(max_error, 0.5 * voxel);
  EXPECT_LT(max_error, 0.25 * voxel);
}

TEST_F(DepthFusionTest, ABoxKeepsItsEdgesWithinAVoxel) {
  const Eigen::Vector3d half(1, 0.7, 0.5);
  write_workspace(folder_, box_caster(half), test_camera(), cameras_all_around(30, 4));
  double voxel = 0;
  const SurfaceMesh mesh = surface_of(folder_, {}, &voxel);
  const SurfaceMeasures measures = measure_surface(mesh);
  EXPECT_EQ(measures.euler(), 2);
  EXPECT_NEAR(measures.volume.value_or(0), 8 * 0.35, 0.02 * 8 * 0.35);
  std::vector<double> errors;
  for (const Eigen::Vector3f& v : mesh.vertices) {
    const Eigen::Vector3d beyond = v.cast<double>().cwiseAbs() - half;
    const Eigen::Vector3d outside = beyond.cwiseMax(0);
    errors.push_back(std::abs(outside.norm() + std::min(0.0, beyond.maxCoeff())));
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() * 9 / 10], 0.5 * voxel);
  EXPECT_LT(errors.back(), 2.5 * voxel);  // where three sides meet
}

TEST_F(DepthFusionTest, UnobservedPartsStayOpen) {
  std::vector<geometry::Rigid3> above;
  for (const geometry::Rigid3& pose : cameras_all_around(30, 4))
    if (pose.center()[2] > 1) above.push_back(pose);
  write_workspace(folder_, sphere_caster({0, 0, 0}, 1), test_camera(), above);
  const SurfaceMeasures measures = measure_surface(surface_of(folder_, {}));
  EXPECT_EQ(measures.holes, 1);
  EXPECT_FALSE(measures.volume.has_value());
}

TEST_F(DepthFusionTest, FreeSpaceRemovesOutliersOfASingleMap) {
  const auto poses = cameras_all_around(24, 4);
  write_workspace(folder_, sphere_caster({0, 0, 0}, 1), test_camera(), poses,
                  [](int i, RenderedView& view) {
                    if (i != 5) return;
                    view.map.depth(cv::Rect(60, 40, 30, 30)) = 2.4F;  // a plate before the sphere
                    view.map.normal(cv::Rect(60, 40, 30, 30)) = cv::Scalar(0, 0, -1);
                    view.map.confidence(cv::Rect(60, 40, 30, 30)) = 0.3F;
                  });
  NoProgress progress;
  const FusedVolume fused = fuse_depth_maps(Workspace::open(folder_), {}, progress, {});
  SurfaceMesh mesh = extract_surface(fused.volume, 4);
  remove_small_parts(mesh, 0.05);
  for (const Eigen::Vector3f& v : mesh.vertices) EXPECT_NEAR(v.norm(), 1, 0.1);
  EXPECT_EQ(measure_surface(mesh).parts, 1);
}

TEST_F(DepthFusionTest, EdgesNextToUnknownDepthsAreTrimmed) {
  write_workspace(folder_, sphere_caster({0, 0, 0}, 1), test_camera(), cameras_all_around(24, 4),
                  [](int, RenderedView& view) {  // three pixels of background as deep as the sphere
                    cv::Mat wide;
                    const cv::Mat flat = view.map.depth == 0;
                    const cv::Mat disc = cv::getStructuringElement(cv::MORPH_ELLIPSE, {7, 7});
                    cv::dilate(view.map.depth, wide, disc);
                    wide.copyTo(view.map.depth, flat);
                    view.map.normal.setTo(cv::Scalar(0, 0, -1), flat);
                  });
  const auto outside = [&](int trim) {
    VolumeOptions options;
    options.trim_px = trim;
    options.dark_level = 0;
    const SurfaceMesh mesh = surface_of(folder_, options);
    return std::count_if(mesh.vertices.begin(), mesh.vertices.end(),
                         [](const Eigen::Vector3f& v) { return v.norm() > 1.05F; });
  };
  EXPECT_EQ(outside(4), 0);
  EXPECT_GT(outside(0), 0);
}

// In all maps, pixels of the background beside the sphere get the sphere's depth. In some, a plate
// floats in front of the dark background. The background is black with noise.
void add_outliers_before_background(int i, RenderedView& view) {
  const cv::Mat flat = view.map.depth == 0;
  cv::Mat wide;
  cv::dilate(view.map.depth, wide, cv::getStructuringElement(cv::MORPH_ELLIPSE, {7, 7}));
  wide.copyTo(view.map.depth, flat);
  if (i % 3 == 0) view.map.depth(cv::Rect(4, 4, 24, 24)) = 4;
  view.map.normal.setTo(cv::Scalar(0, 0, -1), flat);
  cv::Mat noise(view.image.size(), CV_8UC3);
  cv::theRNG().state = static_cast<std::uint64_t>(i) + 1;
  cv::randu(noise, 0, 20);
  noise.copyTo(view.image, flat);
}

TEST_F(DepthFusionTest, NoSurfaceFloatsInFrontOfADarkBackground) {
  write_workspace(folder_, sphere_caster({0, 0, 0}, 1), test_camera(), cameras_all_around(24, 4),
                  add_outliers_before_background);
  const auto outside = [&](int level) {
    VolumeOptions options;
    options.trim_px = 0;
    options.dark_level = level;
    const SurfaceMesh mesh = surface_of(folder_, options);
    EXPECT_GT(mesh.faces.size(), 5000U);
    return std::count_if(mesh.vertices.begin(), mesh.vertices.end(),
                         [](const Eigen::Vector3f& v) { return v.norm() > 1.05F; });
  };
  EXPECT_EQ(outside(24), 0);
  EXPECT_GT(outside(0), 0);
}

TEST(DarkBackground, IsLargeDarkAndUnknownAtTheBorder) {
  cv::Mat image(100, 100, CV_8UC3, cv::Scalar::all(200));
  cv::Mat1f depth(100, 100, 5.F);
  image(cv::Rect(0, 0, 30, 100)) = cv::Scalar::all(10);  // this one is background
  depth(cv::Rect(0, 0, 27, 100)) = 0;
  image(cv::Rect(40, 40, 30, 30)) = cv::Scalar::all(10);  // not at the border
  depth(cv::Rect(40, 40, 30, 30)) = 0;
  image(cv::Rect(80, 0, 20, 50)) = cv::Scalar::all(10);   // dark, but with a surface
  image(cv::Rect(90, 90, 10, 10)) = cv::Scalar::all(10);  // small
  depth(cv::Rect(90, 90, 10, 10)) = 0;
  const cv::Mat1b found = dark_background(image, depth, 24);
  EXPECT_EQ(cv::countNonZero(found), 3000);
  EXPECT_EQ(cv::countNonZero(found(cv::Rect(0, 0, 30, 100))), 3000);
  EXPECT_EQ(cv::countNonZero(dark_background(image, depth, 5)), 0);
  // Maps may be smaller than their images.
  cv::Mat1f half;
  cv::resize(depth, half, {50, 50}, 0, 0, cv::INTER_NEAREST);
  EXPECT_EQ(cv::countNonZero(dark_background(image, half, 24)), 750);
}

TEST_F(DepthFusionTest, ResultDoesNotDependOnThreads) {
  write_workspace(folder_, sphere_caster({0, 0, 0}, 1), test_camera(80, 60, 75),
                  cameras_all_around(12, 4));
  const int before = cv::getNumThreads();
  cv::setNumThreads(1);
  const SurfaceMesh one = surface_of(folder_, {});
  for (const int threads : {2, 4}) {
    cv::setNumThreads(threads);
    const SurfaceMesh more = surface_of(folder_, {});
    EXPECT_EQ(one.faces, more.faces);
    EXPECT_TRUE(std::equal(one.vertices.begin(), one.vertices.end(), more.vertices.begin(),
                           more.vertices.end()));
  }
  cv::setNumThreads(before);
}

TEST_F(DepthFusionTest, InvalidDepthsAreUnknown) {
  const auto poses = cameras_all_around(12, 4);
  write_workspace(folder_, sphere_caster({0, 0, 0}, 1), test_camera(80, 60, 75), poses);
  const Workspace workspace = Workspace::open(folder_);
  DepthMap map = workspace.read_depth_map(3);
  map.depth = std::numeric_limits<float>::quiet_NaN();
  write_colmap_map(workspace.path_of_map(3, "depth_maps", MapKind::kGeometric), map.depth);
  map = workspace.read_depth_map(4);
  map.normal = cv::Scalar::all(std::numeric_limits<double>::infinity());
  write_colmap_map(workspace.path_of_map(4, "normal_maps", MapKind::kGeometric), map.normal);
  NoProgress progress;
  const FusedVolume fused = fuse_depth_maps(workspace, {}, progress, {});
  EXPECT_GE(fused.views_without, 1);
  EXPECT_GE(fused.views, 10);
  EXPECT_NO_THROW(extract_surface(fused.volume, 4).check());
}

TEST_F(DepthFusionTest, ErrorsNameWhatIsMissing) {
  const auto poses = cameras_all_around(4, 4);
  write_workspace(
      folder_, [](const auto&, const auto&) { return std::nullopt; }, test_camera(40, 30, 35),
      poses);
  EXPECT_THAT(error_of(folder_, {}), HasSubstr("no depth map contains a depth"));
  std::filesystem::remove_all(path("stereo"));
  EXPECT_THAT(error_of(folder_, {}), HasSubstr("run tarsier sfm dense"));
}

TEST_F(DepthFusionTest, RespectsTheMemoryLimit) {
  write_workspace(folder_, sphere_caster({0, 0, 0}, 1), test_camera(400, 300, 375),
                  cameras_all_around(4, 4));
  VolumeOptions options;
  options.memory_gb = 0.016;
  NoProgress progress;
  const FusedVolume fused = fuse_depth_maps(Workspace::open(folder_), options, progress, {});
  EXPECT_TRUE(fused.coarser);
  EXPECT_LT(fused.volume.blocks() * 12'000.0, 16e6);
  EXPECT_GT(fused.volume.blocks() * 12'000.0, 6e6);
  options.voxel = 0.005;
  EXPECT_THAT(error_of(folder_, options), HasSubstr("option 'voxel'"));
}

TEST_F(DepthFusionTest, Stops) {
  write_workspace(folder_, sphere_caster({0, 0, 0}, 1), test_camera(40, 30, 35),
                  cameras_all_around(4, 4));
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(error_of(folder_, {}, stop.get_token()), "interrupted");
}

TEST(VolumeOptions, AreChecked) {
  VolumeOptions options;
  options.voxel = -1;
  EXPECT_THROW(options.check(), std::invalid_argument);
  options = {};
  options.truncation = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(options.check(), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
