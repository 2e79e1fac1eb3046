// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/colmap.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/scene/testing_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <limits>
#include <stdexcept>
#include <string>

namespace tarsier::sfm {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class ColmapTest : public FolderTest {
 protected:
  // Files as COLMAP 3.8 writes them, with two cameras and three points.
  void write_colmaps_own() {
    write_file_atomically(path("cameras.txt"),
                          "# Camera list with one line of data per camera:\n"
                          "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
                          "# Number of cameras: 2\n"
                          "7 SIMPLE_RADIAL 3072 2048 2559.81 1536 1024 -0.0204997\n"
                          "2 PINHOLE 640 480 500 510 320 240\n");
    write_file_atomically(path("images.txt"),
                          "# Image list with two lines of data per image:\n"
                          "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
                          "#   POINTS2D[] as (X, Y, POINT3D_ID)\n"
                          "# Number of images: 3, mean observations per image: 2\n"
                          "9 0.5 0.5 0.5 0.5 1 2 3 7 a b.jpg\r\n"
                          "10.5 20.5 63 30.5 40.5 -1 50.5 60.5 5 1.5 2.5 63\n"
                          "4 1 0 0 0 0 0 0 2 sub/c.jpg\n"
                          "1.5 1.5 5 2.5 2.5 63 8.5 8.5 11 9.5 9.5 11\n"
                          "12 1 0 0 0 0 0 -1 2 no-features.jpg\n"
                          "\n");
    write_file_atomically(path("points3D.txt"),
                          "# 3D point list with one line of data per point:\n"
                          "63 1.5 -2.5 10 255 128 1 0.75 9 0 4 1 9 3\n"
                          "11 0 0 1 0 0 0 1 4 2 4 3\n"
                          "5 0 0 12 1 2 3 -1 4 0 9 2\n");
  }

  // The error for COLMAP's files with one text changed.
  std::string refusal(const std::string& file, const std::string& old_text,
                      const std::string& new_text) {
    write_colmaps_own();
    std::string text = contents(path(file));
    const std::size_t position = text.find(old_text);
    EXPECT_NE(position, std::string::npos) << old_text;
    text.replace(position, old_text.size(), new_text);
    write_file_atomically(path(file), text);
    try {
      (void)read_colmap(folder_);
    } catch (const InputError& error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
      return error.what();
    }
    return "accepted";
  }
};

TEST_F(ColmapTest, PosesCanBeReadWithoutPoints) {
  write_colmaps_own();
  const Model complete = read_colmap(folder_);
  std::filesystem::remove(path("points3D.txt"));  // is not read
  const Model poses = read_colmap_poses(folder_);
  ASSERT_EQ(poses.images.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(poses.images[i].name, complete.images[i].name);
    EXPECT_TRUE(poses.images[i].registered);
    EXPECT_EQ(poses.images[i].pose.rotation, complete.images[i].pose.rotation);
    EXPECT_EQ(poses.images[i].pose.translation, complete.images[i].pose.translation);
    EXPECT_EQ(poses.images[i].camera, complete.images[i].camera);
    EXPECT_TRUE(poses.images[i].features.empty());
  }
  EXPECT_TRUE(poses.points.empty());
}

TEST_F(ColmapTest, AModelRoundTripsWithoutUnregisteredImages) {
  const Model model = synthetic_model();
  const std::string folder = path("new/sparse");
  write_colmap(folder, model);
  const Model read = read_colmap(folder);

  ASSERT_EQ(read.cameras.size(), 3U);
  for (std::size_t c = 0; c < 3; ++c) {
    EXPECT_EQ(read.cameras[c].width, model.cameras[c].width);
    EXPECT_EQ(read.cameras[c].height, model.cameras[c].height);
    EXPECT_EQ(read.cameras[c].fx, model.cameras[c].fx);
    EXPECT_EQ(read.cameras[c].fy, model.cameras[c].fy);
    EXPECT_NEAR(read.cameras[c].cx, model.cameras[c].cx, 1e-12);
    EXPECT_NEAR(read.cameras[c].cy, model.cameras[c].cy, 1e-12);
    EXPECT_EQ(read.cameras[c].distortion, model.cameras[c].distortion);
  }
  ASSERT_EQ(read.images.size(), 4U);
  for (std::size_t k = 0; k < 4; ++k) {
    const Image& image = read.images[k];
    const Image& given = model.images[k == 0 ? 0 : k + 1];
    EXPECT_TRUE(image.registered);
    EXPECT_EQ(image.name, given.name);
    EXPECT_EQ(image.camera, given.camera);
    EXPECT_LT((image.pose.rotation - given.pose.rotation).norm(), 1e-14);
    EXPECT_EQ(image.pose.translation, given.pose.translation);
    EXPECT_EQ(image.points, given.points);
    ASSERT_EQ(image.features.size(), given.features.size());
    for (std::size_t f = 0; f < image.features.size(); ++f)
      EXPECT_LT(cv::norm(image.features[f] - given.features[f]), 1e-6);
  }
  ASSERT_EQ(read.points.size(), model.points.size());
  for (std::size_t p = 0; p < read.points.size(); ++p) {
    EXPECT_EQ(read.points[p].position, model.points[p].position);
    EXPECT_EQ(read.points[p].color, model.points[p].color);
    EXPECT_EQ(read.points[p].error, model.points[p].error);
    ASSERT_EQ(read.points[p].track.size(), model.points[p].track.size());
    for (std::size_t k = 0; k < read.points[p].track.size(); ++k) {
      const int image = model.points[p].track[k].image;
      EXPECT_EQ(read.points[p].track[k],
                (Observation{image - (image > 1 ? 1 : 0), model.points[p].track[k].feature}));
    }
  }
}

TEST_F(ColmapTest, OrientationsOfImagesRoundTrip) {
  Model model = synthetic_model();
  model.images[2].turns = 3;
  model.images[3].turns = 1;
  model.images[3].name = "a name with blanks.jpg";
  write_colmap(folder_, model);
  const std::string text = contents(path("images.txt"));
  const Model read = read_colmap(folder_);
  EXPECT_EQ(read.images[0].turns, 0);
  EXPECT_EQ(read.images[1].turns, 3);
  EXPECT_EQ(read.images[2].turns, 1);
  // Comments of other programs are no error.
  for (const char* comment :
       {"# TURNED", "# TURNED ", "# TURNED 9 x", "# TURNED 1", "# TURNED 1 y"}) {
    write_file_atomically(path("images.txt"), std::string(comment) + "\n" + text);
    EXPECT_EQ(read_colmap(folder_).images[1].turns, 3) << comment;
  }
}

TEST_F(ColmapTest, FilesHaveColmapsFormat) {
  Model model = synthetic_model();
  model.images[0].registered = model.images[1].registered;
  model.images = {model.images[0], model.images[2], model.images[3]};
  model.points.resize(1);
  model.points[0].track = {{1, 0}, {2, 1}};
  model.points[0].position = {0.1, 2, 3};
  model.points[0].color = {3, 2, 1};
  model.points[0].error = 0.5;
  for (Image& image : model.images) {
    image.features = {{10.F, 20.25F}, {100.F, 0.F}};
    image.points = {-1, -1};
  }
  model.images[1].points[0] = 0;
  model.images[2].points[1] = 0;
  model.images[2].pose = {};
  write_colmap(folder_, model);
  EXPECT_EQ(files(), 3U);
  EXPECT_THAT(
      contents(path("cameras.txt")),
      AllOf(HasSubstr("\n1 PINHOLE 640 480 500.25 501.75 320 240\n"),
            HasSubstr("\n2 FULL_OPENCV 800 600 700 700 400.5 300.5 -0.1"), Not(HasSubstr("\n3 "))));
  EXPECT_THAT(contents(path("images.txt")),
              HasSubstr("\n2 1 0 0 0 0 0 0 1 folder/photo 3.jpg\n10.5 20.75 -1 100.5 0.5 1\n"));
  EXPECT_THAT(contents(path("points3D.txt")),
              HasSubstr("\n1 0.10000000000000001 2 3 1 2 3 0.5 1 0 2 1\n"));
}

TEST_F(ColmapTest, ColmapsOwnFilesAreRead) {
  write_colmaps_own();
  const Model model = read_colmap(folder_);
  ASSERT_EQ(model.cameras.size(), 2U);
  EXPECT_EQ(model.cameras[0].fy, 2559.81);
  EXPECT_EQ(model.cameras[0].cx, 1535.5);
  EXPECT_EQ(model.cameras[0].distortion[0], -0.0204997);
  EXPECT_EQ(model.cameras[1].fy, 510);
  ASSERT_EQ(model.images.size(), 3U);
  EXPECT_EQ(model.images[0].name, "a b.jpg");
  EXPECT_EQ(model.images[1].name, "sub/c.jpg");
  EXPECT_EQ(model.images[1].camera, 1);
  EXPECT_TRUE(model.images[2].features.empty());
  EXPECT_EQ(model.images[0].features[0], cv::Point2f(10, 20));
  // The quaternion (1 1 1 1)/2 turns x to y.
  EXPECT_LT((model.images[0].pose * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(1, 3, 3)).norm(),
            1e-12);
  // Point 63 has two features in one image: the first one is kept. Point 11 is observed by one
  // image only.
  ASSERT_EQ(model.points.size(), 2U);
  EXPECT_THAT(model.points[0].track, ElementsAre(Observation{0, 0}, Observation{1, 1}));
  EXPECT_EQ(model.points[0].color, cv::Vec3b(1, 128, 255));
  EXPECT_EQ(model.points[0].error, 0.75);
  EXPECT_EQ(model.points[1].error, 0);
  EXPECT_THAT(model.images[0].points, ElementsAre(0, -1, 1, -1));
  EXPECT_THAT(model.images[1].points, ElementsAre(1, 0, -1, -1));
  // A model that was read can be written.
  write_colmap(path("again"), model);
  EXPECT_EQ(read_colmap(path("again")).points.size(), 2U);
}

TEST_F(ColmapTest, TheLastEmptyLineOfImagesMayBeMissing) {
  EXPECT_EQ(refusal("images.txt", "no-features.jpg\n\n", "no-features.jpg"), "accepted");
}

TEST_F(ColmapTest, ErrorsNameFileAndLine) {
  const auto cameras = [&](const std::string& from, const std::string& to) {
    return refusal("cameras.txt", from, to);
  };
  EXPECT_THAT(cameras("2 PINHOLE", "7 PINHOLE"),
              HasSubstr("cameras.txt: line 5: camera 7 occurs twice"));
  EXPECT_THAT(cameras("2 PINHOLE", "2 FISHEYE"), HasSubstr("line 5: camera model 'FISHEYE'"));
  EXPECT_THAT(cameras("2 PINHOLE", "x PINHOLE"), HasSubstr("'x' is not the number of a camera"));
  EXPECT_THAT(cameras("640", "0"), HasSubstr("'0' is not a width"));
  EXPECT_THAT(cameras("640", "99999999999999999999"), HasSubstr("is not a width"));
  EXPECT_THAT(cameras("500", "nan"), HasSubstr("'nan' is not a number"));
  EXPECT_THAT(cameras("500", "-1"), HasSubstr("focal"));
  EXPECT_THAT(cameras("320 240", "320"), HasSubstr("'' is not a number; PINHOLE has 4"));
  EXPECT_THAT(cameras("320 240", "320 240 1"), HasSubstr("PINHOLE has 4 parameters"));

  const auto images = [&](const std::string& from, const std::string& to) {
    return refusal("images.txt", from, to);
  };
  EXPECT_THAT(images("4 1 0 0 0 0", "9 1 0 0 0 0"), HasSubstr("line 7: image 9 occurs twice"));
  EXPECT_THAT(images("4 1 0 0 0 0", "-4 1 0 0 0 0"), HasSubstr("the image's id '-4'"));
  EXPECT_THAT(images("4 1 0 0 0 0", "4 0 0 0 0 0"), HasSubstr("quaternion has length 0"));
  EXPECT_THAT(images("4 1 0 0 0 0", "4 1 0 0 0 inf"), HasSubstr("the translation 'inf'"));
  EXPECT_THAT(images("7 a b.jpg", "8 a b.jpg"), HasSubstr("line 5: camera 8 is unknown"));
  EXPECT_THAT(images("sub/c.jpg", ""), HasSubstr("has no name"));
  EXPECT_THAT(images("sub/c.jpg", "a b.jpg"), HasSubstr("'a b.jpg' occurs twice"));
  EXPECT_THAT(images("sub/c.jpg", "a/../../c.jpg"), HasSubstr("outside the folder"));
  EXPECT_THAT(images("sub/c.jpg", "/etc/passwd"), HasSubstr("outside the folder"));
  EXPECT_THAT(images("sub/c.jpg", "\x1b[2J"), AllOf(HasSubstr("\\x1b"), Not(HasSubstr("\x1b"))));
  EXPECT_THAT(images(std::string("9.5 9.5 11"), "9.5 9.5"), HasSubstr("line 8: a feature's point"));
  EXPECT_THAT(images("9.5 9.5 11", "1e300 9.5 11"), HasSubstr("far outside"));
  EXPECT_THAT(images("9.5 9.5 11", "9.5 9.5 99"), HasSubstr("points3D.txt: line 3"));
  EXPECT_THAT(images("30.5 40.5 -1", "30.5 40.5 11"),
              HasSubstr("images.txt: line 6: feature 1 belongs to point 11"));

  const auto points = [&](const std::string& from, const std::string& to) {
    return refusal("points3D.txt", from, to);
  };
  EXPECT_THAT(points("\n5 0", "\n11 0"), HasSubstr("points3D.txt: line 4: point 11 occurs twice"));
  EXPECT_THAT(points("255 128 1", "256 128 1"), HasSubstr("the colour '256'"));
  EXPECT_THAT(points("1.5 -2.5", "1.5 1e999"), HasSubstr("the position '1e999'"));
  EXPECT_THAT(points("9 0 4 1", "8 0 4 1"), HasSubstr("image 8 is unknown"));
  EXPECT_THAT(points("9 0 4 1", "9 2147483648 4 1"), HasSubstr("a feature of the track"));
  EXPECT_THAT(points("9 0 4 1", "9 0 9 0"), HasSubstr("feature 0 of image 9"));
  EXPECT_THAT(points("9 0 4 1", "9 0 4"), HasSubstr("line 2: "));
  EXPECT_THAT(points("-1 4 0 9 2", "-1 4 0"), HasSubstr("fewer than two"));
  EXPECT_THAT(points("-1 4 0 9 2", "-1"), HasSubstr("fewer than two"));
  EXPECT_THAT(points("\n5 0", std::string("\n\0\xFF 0", 5)), HasSubstr("the point's id"));
}

TEST_F(ColmapTest, ErrorsNameMissingAndInvalidFiles) {
  const auto error_of = [&] {
    try {
      (void)read_colmap(folder_);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  EXPECT_THAT(error_of(), HasSubstr("cameras.txt: no such file"));
  write_colmaps_own();
  std::filesystem::remove(path("points3D.txt"));
  EXPECT_THAT(error_of(), HasSubstr("points3D.txt: no such file"));
  std::filesystem::create_directory(path("points3D.txt"));
  EXPECT_THAT(error_of(), HasSubstr("points3D.txt: is not a regular file"));
  std::filesystem::remove(path("images.txt"));
  write_file_atomically(path("images.txt"), "");
  // Large files are read (a model of ten thousand images has 2 GB), endless lines are not. The file
  // is sparse and occupies no space.
  write_file_atomically(path("images.txt"), "# a comment\n");
  std::filesystem::resize_file(path("images.txt"), 3'000'000'000);
  EXPECT_THAT(error_of(), HasSubstr("images.txt: line 2: longer than"));
}

TEST_F(ColmapTest, InconsistentModelsAreNotWritten) {
  const Model good = synthetic_model();
  const auto refused = [&](const auto& change) {
    Model model = good;
    change(model);
    EXPECT_THROW(write_colmap(path("out"), model), std::invalid_argument);
    EXPECT_EQ(files(), 0U);
  };
  refused([](Model& m) { m.images[0].camera = 3; });
  refused([](Model& m) { m.images[0].points.pop_back(); });
  refused([](Model& m) { m.images[1].registered = m.images[0].registered = false; });
  refused([](Model& m) { m.images[2].name = m.images[0].name; });
  refused([](Model& m) { m.images[2].pose.rotation = 2 * Eigen::Matrix3d::Identity(); });
  refused([](Model& m) { m.points[0].track.resize(1); });
  refused([](Model& m) { m.points[0].track[0].feature = 1000; });
  refused([](Model& m) { m.points[0].track[1].image = -1; });
  refused([](Model& m) { std::swap(m.points[0].track, m.points[1].track); });
  refused([](Model& m) { m.points[0].position[1] = std::numeric_limits<double>::quiet_NaN(); });
  refused([](Model& m) { m.points.pop_back(); });
  refused([](Model& m) { m.cameras[0].fx = 0; });
  Model model = good;
  model.images[0].name = "a\nb.jpg";
  EXPECT_THROW(write_colmap(path("out"), model), OutputError);
  EXPECT_EQ(files(), 0U);
}

}  // namespace
}  // namespace tarsier::sfm
