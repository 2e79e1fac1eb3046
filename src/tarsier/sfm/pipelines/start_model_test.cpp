// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/start_model.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/scene/colmap.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace tarsier::sfm {
namespace {

using testing::HasSubstr;

class StartModelTest : public FolderTest {
 protected:
  // Two cameras, four images.
  [[nodiscard]] Model model() const {
    Model model;
    geometry::Camera camera;
    camera.width = 640;
    camera.height = 480;
    camera.fx = camera.fy = 700;
    camera.cx = 320;
    camera.cy = 240;
    model.cameras = {camera, camera};
    model.cameras[1].fx = model.cameras[1].fy = 900;
    for (int i = 0; i < 4; ++i) {
      Image image;
      image.name = i == 0 ? "left/0.jpg" : std::to_string(i) + ".jpg";
      image.camera = i == 3 ? 1 : 0;
      image.registered = true;
      image.pose.translation = {static_cast<double>(i), 0, 0};
      model.images.push_back(image);
    }
    return model;
  }

  static ImageFeatures found(int input, const char* from, const std::string& body) {
    ImageFeatures image;
    image.input = input;
    image.size = {640, 480};
    image.lens.camera.width = 640;
    image.lens.camera.height = 480;
    image.lens.camera.fx = image.lens.camera.fy = 768;
    image.lens.source = from;
    image.body = body;
    return image;
  }
};

TEST_F(StartModelTest, AssignsCamerasByImageName) {
  write_colmap(path("model"), model());
  const std::vector<Input> inputs{{"left/0.jpg", "a"}, {"1.jpg", "b"}, {"3.jpg", "c"},
                                  {"9.jpg", "d"},      {"8.jpg", "e"}, {"7.jpg", "f"}};
  const StartModel start(path("model"), inputs);
  EXPECT_EQ(start.summary().images, 4);
  EXPECT_EQ(start.summary().in_inputs, 3);
  EXPECT_TRUE(start.has("left/0.jpg"));
  EXPECT_FALSE(start.has("2.jpg"));
  EXPECT_NO_THROW(start.check_size(inputs[0], {640, 480}));
  EXPECT_NO_THROW(start.check_size(inputs[3], {64, 48}));
  EXPECT_THROW(start.check_size(inputs[0], {640, 400}), InputError);

  // The fourth image has the make of the first two; the fifth's lens is given; the sixth is of
  // another make.
  std::vector<ImageFeatures> images{found(0, "guess", "A"), found(1, "guess", "A"),
                                    found(2, "guess", "B"), found(3, "guess", "A"),
                                    found(4, "given", "A"), found(5, "guess", "C")};
  EXPECT_EQ(start.set_lenses(inputs, images), (std::vector<char>{1, 1, 1, 1, 0, 0}));
  EXPECT_EQ(images[0].lens.camera.fx, 700);
  EXPECT_EQ(images[1].body, images[0].body);
  EXPECT_EQ(images[2].lens.camera.fx, 900);
  EXPECT_NE(images[2].body, images[0].body);
  EXPECT_EQ(images[3].lens.camera.fx, 700);
  EXPECT_EQ(images[3].body, images[0].body);
  EXPECT_EQ(images[4].lens.camera.fx, 768);
  EXPECT_STREQ(images[5].lens.source, "guess");
  const StartPoses poses = start.poses(inputs, images, {0, 0, 1, 0, 2, 3}, true, false);
  EXPECT_EQ(poses.poses[2]->translation, Eigen::Vector3d(3, 0, 0));
  EXPECT_FALSE(poses.poses[3]);
  EXPECT_EQ(poses.fixed_cameras, (std::vector<int>{0, 1}));
  EXPECT_TRUE(start.poses(inputs, images, {0, 0, 1, 0, 2, 3}, true, true).fixed_cameras.empty());
}

TEST_F(StartModelTest, ErrorsNameUnusableFolders) {
  const auto message = [&](const std::string& folder, const std::vector<Input>& inputs) {
    try {
      const StartModel start(folder, inputs);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("none");
  };
  EXPECT_THAT(message(path("nothing"), {{"1.jpg", "b"}, {"2.jpg", "c"}}), HasSubstr("cameras.txt"));
  write_colmap(path("model"), model());
  EXPECT_THAT(message(path("model"), {{"1.jpg", "b"}, {"x.jpg", "c"}}),
              HasSubstr("1 of the 4 images of this model is among the inputs by name"));
  Model fisheye = model();
  fisheye.cameras[1].lens = geometry::Lens::kFisheye;
  write_colmap(path("fisheye"), fisheye);
  EXPECT_EQ(message(path("fisheye"), {{"1.jpg", "b"}, {"2.jpg", "c"}}), "none") << "is not used";
  EXPECT_THAT(message(path("fisheye"), {{"1.jpg", "b"}, {"3.jpg", "c"}}),
              HasSubstr("'3.jpg' has a fisheye lens"));
}

}  // namespace
}  // namespace tarsier::sfm
