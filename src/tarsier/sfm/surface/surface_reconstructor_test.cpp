// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/surface_reconstructor.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/render/obj_io.h"
#include "tarsier/sfm/surface/surface_view.h"
#include "tarsier/sfm/surface/testing_surface.h"
#include "tarsier/sfm/surface/view_scan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace tarsier::sfm {
namespace {

using testing::HasSubstr;

SurfaceResult surface_of(const std::string& folder, const SurfaceOptions& options) {
  NoProgress progress;
  return SurfaceReconstructor(options).run(Workspace::open(folder), progress, {});
}

// The texture's colour in the middle of each face.
cv::Vec3f texture_color(const SurfaceTexture& texture, std::size_t face) {
  cv::Vec2f uv(0, 0);
  for (const int corner : texture.corners[face])
    uv += texture.uvs[static_cast<std::size_t>(corner)] / 3;
  return color_at(texture.image, {static_cast<double>(uv[0]) * texture.image.cols - 0.5,
                                  (1 - static_cast<double>(uv[1])) * texture.image.rows - 0.5});
}

Eigen::Vector3d middle_of(const SurfaceMesh& mesh, std::size_t face) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const int v : mesh.faces[face])
    sum += mesh.vertices[static_cast<std::size_t>(v)].cast<double>() / 3;
  return sum;
}

// Error of the mean of three channels in grey levels: the 95th percentile over the faces.
double color_error(const SurfaceResult& result) {
  std::vector<double> errors;
  for (std::size_t f = 0; f < result.surface.mesh.faces.size(); ++f) {
    const cv::Vec3f truth(test_color(middle_of(result.surface.mesh, f).normalized()));
    errors.push_back(cv::norm(truth - texture_color(*result.surface.texture, f), cv::NORM_L1) / 3);
  }
  std::sort(errors.begin(), errors.end());
  return errors[errors.size() * 95 / 100];
}

// A sphere that 12 cameras see.
class SurfaceReconstructorTest : public FolderTest {
 protected:
  void write_sphere(const std::function<void(int, RenderedView&)>& change = {}) {
    write_workspace(folder_, sphere_caster({0, 0, 0}, 1), test_camera(), cameras_all_around(12, 4),
                    change);
  }
  [[nodiscard]] static SurfaceOptions small_options() {
    SurfaceOptions options;
    options.faces = 4000;
    options.texture = 512;
    return options;
  }
};

TEST_F(SurfaceReconstructorTest, ASphereHasItsColors) {
  write_sphere();
  const SurfaceResult result = surface_of(folder_, small_options());
  EXPECT_EQ(result.views, 12);
  EXPECT_EQ(result.measures.euler(), 2);
  EXPECT_EQ(result.unseen_faces, 0);
  EXPECT_LE(result.surface.mesh.faces.size(), 4000U);
  const double truth = 4.0 / 3 * std::numbers::pi;
  EXPECT_NEAR(result.measures.volume.value_or(0), truth, 0.01 * truth);
  for (const Eigen::Vector3f& v : result.surface.mesh.vertices)
    EXPECT_NEAR(v.norm(), 1, 0.5 * result.voxel);
  ASSERT_TRUE(result.surface.texture.has_value());
  EXPECT_LE(result.surface.texture->charts, 40);
  EXPECT_LT(color_error(result), 4);
  for (std::size_t v = 0; v < result.surface.mesh.vertices.size(); ++v) {
    const cv::Vec3b truth_color =
        test_color(result.surface.mesh.vertices[v].cast<double>().normalized());
    EXPECT_LT(cv::norm(truth_color, result.surface.mesh.colors[v], cv::NORM_INF), 6);
  }
  const nlohmann::ordered_json json = to_json(result);
  EXPECT_EQ(json["closed"], true);
  EXPECT_EQ(json["largest_holes"].size(), 0U);
  EXPECT_EQ(json["texture"]["charts"], result.surface.texture->charts);
}

TEST_F(SurfaceReconstructorTest, SeamsOfUnequalExposureAreLevelled) {
  write_sphere([](int i, RenderedView& view) {
    view.image.convertTo(view.image, -1, 1, i % 2 == 0 ? 12 : -12);  // half of the images darker
  });
  SurfaceOptions options = small_options();
  const auto steps_of = [&](bool level) {
    options.level_seams = level;
    const SurfaceResult result = surface_of(folder_, options);
    // The difference between neighbouring faces; it is small without seams.
    const std::vector<Face> neighbors = face_neighbors(result.surface.mesh);
    double max_step = 0;
    int large = 0;
    for (std::size_t f = 0; f < neighbors.size(); ++f) {
      for (const int other : neighbors[f]) {
        const double step = cv::norm(
            texture_color(*result.surface.texture, f),
            texture_color(*result.surface.texture, static_cast<std::size_t>(other)), cv::NORM_INF);
        max_step = std::max(max_step, step);
        if (step > 16) ++large;
      }
    }
    return std::pair(max_step, large);
  };
  const auto [max_step_before, large_before] = steps_of(false);
  const auto [max_step_after, large_after] = steps_of(true);
  EXPECT_GT(large_before, 100);
  EXPECT_LT(large_after, large_before / 20);
  EXPECT_GT(max_step_before, 20);
}

TEST_F(SurfaceReconstructorTest, ASmallTextureIsReducedAndATinyOneIsRefused) {
  write_sphere();
  SurfaceOptions options = small_options();
  options.texture = 128;
  const SurfaceResult result = surface_of(folder_, options);
  EXPECT_LT(result.surface.texture->scale, 1);
  EXPECT_LE(result.surface.texture->image.cols, 128);
  EXPECT_LE(result.surface.texture->image.rows, 128);
  EXPECT_LT(color_error(result), 10);
  options.texture = 63;
  EXPECT_THROW(options.check(), std::invalid_argument);
}

TEST_F(SurfaceReconstructorTest, UnseenFacesHaveTheColorsOfTheirSurroundings) {
  std::vector<geometry::Rigid3> above;
  for (const geometry::Rigid3& pose : cameras_all_around(20, 4))
    if (pose.center()[2] > 0) above.push_back(pose);
  write_workspace(folder_, sphere_caster({0, 0, 0}, 1), test_camera(), above);
  SurfaceOptions options = small_options();
  EXPECT_FALSE(surface_of(folder_, options).measures.volume.has_value());
  options.close_holes = 1;
  const SurfaceResult result = surface_of(folder_, options);
  EXPECT_TRUE(result.measures.volume.has_value());
  EXPECT_EQ(result.measures.euler(), 2);
  EXPECT_GT(result.unseen_faces, 20);
  EXPECT_GE(result.holes_closed, 1);
  int black = 0;
  for (std::size_t f = 0; f < result.surface.mesh.faces.size(); ++f)
    if (cv::norm(texture_color(*result.surface.texture, f), cv::NORM_INF) < 20) ++black;
  EXPECT_EQ(black, 0);
}

TEST_F(SurfaceReconstructorTest, ADarkBackgroundGivesNoColors) {
  write_sphere();
  const SurfaceMesh mesh = surface_of(folder_, small_options()).surface.mesh;
  write_sphere([](int i, RenderedView& view) {  // only the first image contains the sphere
    if (i == 0) return;
    view.image.setTo(cv::Scalar::all(3));
    view.map.depth = cv::Mat(view.map.depth.size(), CV_32FC1, cv::Scalar::all(0));
  });
  const auto faces_of_others = [&](int dark_level) {
    NoProgress progress;
    const ViewScan scan =
        scan_views(Workspace::open(folder_), mesh, 0.05, dark_level, progress, {});
    EXPECT_LT(scan.unseen_faces, static_cast<int>(mesh.faces.size()));
    return std::count_if(scan.faces.begin(), scan.faces.end(),
                         [](const FaceViews& some) { return some[0].view > 0; });
  };
  EXPECT_EQ(faces_of_others(24), 0);
  EXPECT_GT(faces_of_others(0), 1000);
}

TEST_F(SurfaceReconstructorTest, ScalesTheResult) {
  write_sphere();
  SurfaceOptions options = small_options();
  options.texture = 0;
  options.scale = 10;
  const SurfaceResult result = surface_of(folder_, options);
  EXPECT_FALSE(result.surface.texture.has_value());
  const double truth = 1000 * 4.0 / 3 * std::numbers::pi;
  EXPECT_NEAR(result.measures.volume.value_or(0), truth, 0.01 * truth);
}

TEST_F(SurfaceReconstructorTest, ResultDoesNotDependOnThreads) {
  write_sphere();
  const int before = cv::getNumThreads();
  std::vector<std::string> files;
  for (const int threads : {1, 2, 4}) {
    cv::setNumThreads(threads);
    const std::string file = path("mesh" + std::to_string(threads) + ".glb");
    write_surface(file, surface_of(folder_, small_options()).surface);
    files.push_back(contents(file));
  }
  cv::setNumThreads(before);
  EXPECT_TRUE(files[0] == files[1]);
  EXPECT_TRUE(files[0] == files[2]);
}

TEST_F(SurfaceReconstructorTest, FilesHoldTheSurface) {
  write_sphere();
  const SurfaceResult result = surface_of(folder_, small_options());
  const SurfaceMesh& mesh = result.surface.mesh;
  write_surface(path("mesh.obj"), result.surface);
  const render::ObjFile obj = render::read_obj(path("mesh.obj"));
  EXPECT_TRUE(obj.notes.empty());
  EXPECT_EQ(obj.mesh.positions.size(), mesh.vertices.size());
  EXPECT_EQ(obj.mesh.triangles.size(), mesh.faces.size());
  EXPECT_EQ(obj.mesh.uvs.size(), result.surface.texture->uvs.size());
  ASSERT_EQ(obj.mesh.textures.size(), 1U);
  EXPECT_EQ(obj.mesh.textures[0].levels[0].size(), result.surface.texture->image.size());
  EXPECT_EQ(obj.mesh.triangles[7].position, mesh.faces[7]);
  EXPECT_EQ(surface_files("mesh.obj", true),
            (std::vector<std::string>{"mesh.png", "mesh.mtl", "mesh.obj"}));

  write_surface(path("mesh.ply"), result.surface);
  const std::string ply = contents(path("mesh.ply"));
  EXPECT_THAT(ply.substr(0, 600), HasSubstr("comment TextureFile mesh.png\n"));
  const std::size_t body = ply.find("end_header\n") + 11;
  EXPECT_EQ(ply.size() - body, mesh.vertices.size() * 27 + mesh.faces.size() * (13 + 25));
  float x = 0;
  std::memcpy(&x, ply.data() + body + 27 * 5, 4);
  EXPECT_EQ(x, mesh.vertices[5][0]);

  write_surface(path("mesh.glb"), result.surface);
  const std::string glb = contents(path("mesh.glb"));
  const auto number = [&](std::size_t offset) {
    std::uint32_t value = 0;
    std::memcpy(&value, glb.data() + offset, 4);
    return value;
  };
  EXPECT_EQ(glb.substr(0, 4), "glTF");
  EXPECT_EQ(number(8), glb.size());
  const auto json = nlohmann::json::parse(glb.substr(20, number(12)));
  const auto& accessors = json["accessors"];
  const auto& primitive = json["meshes"][0]["primitives"][0];
  EXPECT_EQ(accessors[primitive["indices"].get<std::size_t>()]["count"], mesh.faces.size() * 3);
  EXPECT_EQ(json["buffers"][0]["byteLength"], number(20 + number(12)));
  EXPECT_EQ(json["images"][0]["mimeType"], "image/jpeg");
}

TEST_F(SurfaceReconstructorTest, AFailedWriteLeavesNoFile) {
  write_sphere();
  SurfaceOptions options = small_options();
  options.texture = 0;
  const SurfaceResult result = surface_of(folder_, options);
  for (const std::string& file : {path("missing/mesh.ply"), path("missing/mesh.glb")})
    EXPECT_THROW(write_surface(file, result.surface), OutputError);
  if (std::filesystem::exists("/dev/full")) {
    std::filesystem::create_symlink("/dev/full", path("full.obj"));
    EXPECT_THROW(write_surface(path("full.obj"), result.surface), OutputError);
  }
  EXPECT_THROW(write_surface(path("mesh.stl"), result.surface), UsageError);
  EXPECT_FALSE(std::filesystem::exists(path("mesh.stl")));
}

TEST_F(SurfaceReconstructorTest, IsDrawnAsTheCamerasSeeIt) {
  write_sphere();
  const SurfaceResult result = surface_of(folder_, small_options());
  const Workspace workspace = Workspace::open(folder_);
  ViewOptions view;
  view.size = {160, 120};
  const cv::Mat image = render_surface(result.surface, workspace.sparse(), view);
  int drawn = 0;
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols; ++x)
      if (image.at<cv::Vec3b>(y, x) != view.background) ++drawn;
  EXPECT_GT(drawn, 2000);  // of 19200
  EXPECT_LT(drawn, 15000);
  int frames = 0;
  render_surface_turntable(result.surface, workspace.sparse(), view, 3,
                           [&](int, const cv::Mat& frame) {
                             EXPECT_EQ(frame.size(), view.size);
                             ++frames;
                           });
  EXPECT_EQ(frames, 3);
  const Eigen::Matrix3d upright = upright_of(result.surface, workspace.sparse());
  EXPECT_NEAR(upright.determinant(), 1, 1e-9);
}

TEST_F(SurfaceReconstructorTest, Stops) {
  write_sphere();
  std::stop_source stop;
  stop.request_stop();
  NoProgress progress;
  EXPECT_THROW((void)SurfaceReconstructor(small_options())
                   .run(Workspace::open(folder_), progress, stop.get_token()),
               Interrupted);
}

TEST(DepthOfSurface, IsThatOfTheNearestFace) {
  SurfaceMesh mesh;
  mesh.vertices = {{-1, -1, 2}, {1, -1, 2}, {0, 1, 2}, {-1, -1, 3}, {1, -1, 3}, {0, 1, 3}};
  mesh.faces = {{3, 4, 5}, {0, 1, 2}};
  const cv::Mat1f depth = depth_of_surface(mesh, test_camera(81, 61, 40), {});
  EXPECT_FLOAT_EQ(depth(30, 40), 2);
  EXPECT_TRUE(std::isinf(depth(0, 0)));
}

}  // namespace
}  // namespace tarsier::sfm
