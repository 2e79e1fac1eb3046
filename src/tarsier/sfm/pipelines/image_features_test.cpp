// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/image_features.h"

#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/scene/testing_exif.h"
#include "tarsier/sfm/two_view/testing_camera_path.h"

#include <gtest/gtest.h>

#include <span>
#include <string>

namespace tarsier::sfm {
namespace {

const cv::Size kSize(64, 48);

geometry::Camera landscape() {
  geometry::Camera camera;
  camera.width = kSize.width;
  camera.height = kSize.height;
  camera.fx = 70;
  camera.fy = 72;
  camera.cx = 30.2;
  camera.cy = 25.9;
  camera.distortion = {0.05, -0.02, 0.003, -0.004, 0.001};
  return camera;
}

class InputImage : public FolderTest {
 protected:
  ImageFeatures read(cv::Size size, int orientation, const PipelineOptions& options) {
    cv::Mat pixels(size, CV_8UC3, cv::Scalar::all(90));
    const std::string file = path("image.jpg");
    const auto bytes = with_orientation(encode_image(".jpg", pixels, file), orientation);
    write_file_atomically(file, std::span<const std::uint8_t>(bytes));
    ImageFeatures features;
    const cv::Mat image = read_input_image({"image.jpg", file}, options, features);
    EXPECT_EQ(image.size(), features.size);
    return features;
  }
};

TEST_F(InputImage, LensDoesNotDependOnOrientation) {
  PipelineOptions options;
  options.camera = landscape();
  PipelineOptions guessed;
  ImageSet given_set(options);
  ImageSet guessed_set(guessed);
  for (int orientation = 1; orientation <= 8; ++orientation) {
    SCOPED_TRACE(orientation);
    const ImageFeatures image = read(kSize, orientation, options);
    EXPECT_EQ(image.size, kSize);
    EXPECT_STREQ(image.lens.source, "given");
    EXPECT_EQ(image.lens.camera.cx, landscape().cx);
    EXPECT_EQ(image.lens.camera.distortion, landscape().distortion);
    given_set.add(image, std::to_string(orientation));
    guessed_set.add(read(kSize, orientation, guessed), std::to_string(orientation));
    EXPECT_EQ(given_set.images().back().turns, image.turns);
  }
  EXPECT_EQ(given_set.cameras().size(), 1U);
  EXPECT_EQ(guessed_set.cameras().size(), 1U);
}

TEST(ImageSetCameras, AreSharedByImagesOfTheSameLens) {
  ImageFeatures image;
  image.size = kSize;
  image.lens = {landscape(), "database"};
  ImageSet set(PipelineOptions{});
  set.add(image, "a");
  set.add(image, "b");
  image.lens.camera.cx += 1;
  set.add(image, "principal point");
  image.lens.camera = landscape();
  image.lens.camera.distortion[4] = 0.002;
  set.add(image, "distortion");
  image.lens.camera = landscape();
  image.body = "another";
  set.add(image, "body");
  std::vector<int> cameras;
  for (const Image& one : set.images()) cameras.push_back(one.camera);
  EXPECT_EQ(cameras, (std::vector<int>{0, 0, 1, 2, 3}));
}

// A camera that was calibrated with upright images.
TEST_F(InputImage, RotatesCameraOfSwappedSides) {
  geometry::Camera upright = landscape();
  std::swap(upright.width, upright.height);
  std::swap(upright.cx, upright.cy);
  PipelineOptions options;
  options.camera = upright;
  for (const int orientation : {5, 6, 7, 8}) {
    SCOPED_TRACE(orientation);
    const ImageFeatures image = read(kSize, orientation, options);
    ASSERT_STREQ(image.lens.source, "given");
    EXPECT_EQ(image.lens.camera.width, kSize.width);
    // A point in the camera's frame, and in the frame of the upright camera.
    const Eigen::Vector3d point(0.2, -0.13, 1);
    Eigen::Vector3d turned = point;
    cv::Point2d pixel = *image.lens.camera.project(point);
    int height = image.size.height;
    for (int k = 0; k < image.turns; ++k) {
      turned = Eigen::Vector3d(-turned.y(), turned.x(), turned.z());
      pixel = cv::Point2d(height - 1 - pixel.y, pixel.x);
      height = image.size.width + image.size.height - height;
    }
    const cv::Point2d expected = *upright.project(turned);
    EXPECT_NEAR(pixel.x, expected.x, 1e-9);
    EXPECT_NEAR(pixel.y, expected.y, 1e-9);
  }
}

TEST_F(InputImage, RotatedWithoutExifCentersPrincipalPoint) {
  PipelineOptions options;
  options.camera = landscape();
  const cv::Size turned(2 * kSize.height, 2 * kSize.width);  // and twice the size
  const ImageFeatures image = read(turned, 1, options);
  ASSERT_STREQ(image.lens.source, "given");
  const geometry::Camera& camera = image.lens.camera;
  EXPECT_EQ(cv::Size(camera.width, camera.height), turned);
  EXPECT_DOUBLE_EQ(camera.fx, 2 * landscape().fy);
  EXPECT_DOUBLE_EQ(camera.fy, 2 * landscape().fx);
  EXPECT_DOUBLE_EQ(camera.cx, (turned.width - 1) / 2.0);
  EXPECT_DOUBLE_EQ(camera.cy, (turned.height - 1) / 2.0);
  EXPECT_EQ(camera.distortion[0], landscape().distortion[0]);
  EXPECT_EQ(camera.distortion[2], 0);

  // It is not used for another aspect ratio.
  EXPECT_STREQ(read({60, 60}, 1, options).lens.source, "guess");
}

// A model gives another focal length.
TEST(ImageSet, AdoptsFocalLengthOfModel) {
  CameraPath scene(800);
  ImageSet images{PipelineOptions()};
  for (const Image& image : scene.images) {
    ImageFeatures features;
    features.size = {640, 480};
    features.lens = {scene.cameras[0], "guess"};
    features.features.points = image.features;
    images.add(features, "image");
  }
  Model model;
  model.cameras = scene.cameras;
  model.images = scene.images;
  for (Image& image : model.images) image.registered = true;
  std::vector<Pair> pairs = scene.pairs;
  EXPECT_TRUE(images.adopt_focal_lengths({model}, 0.15, pairs, {}).empty());  // the same
  EXPECT_FALSE(images.is_estimated(0));
  model.cameras[0].fx = model.cameras[0].fy = kTrueFocal;
  EXPECT_EQ(images.adopt_focal_lengths({model}, 0.15, pairs, {}).size(), 1U);
  EXPECT_TRUE(images.is_estimated(0));
  EXPECT_EQ(images.cameras()[0].fx, kTrueFocal);
  for (const Pair& pair : pairs) {
    const geometry::Rigid3 truth =
        scene.images[static_cast<std::size_t>(pair.second)].pose *
        scene.images[static_cast<std::size_t>(pair.first)].pose.inverse();
    EXPECT_LT(geometry::angle_of(truth.rotation * pair.view.second_from_first.rotation.transpose()),
              0.02);
  }
}

}  // namespace
}  // namespace tarsier::sfm
