// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/marker_scale.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace tarsier::sfm {
namespace {

constexpr double kSide = 0.05;  // m
constexpr double kUnit = 3.7;   // units of the model per metre

// Three cameras around two markers on a table. The model is `kUnit` times as large as the truth.
class MarkerScaleTest : public FolderTest {
 protected:
  MarkerScaleTest() {
    geometry::Camera camera;
    camera.width = 640;
    camera.height = 480;
    camera.fx = camera.fy = 700;
    camera.cx = 319.5;
    camera.cy = 239.5;
    camera.distortion[0] = -0.08;
    model_.cameras.push_back(camera);
    for (int i = 0; i < 3; ++i) {
      Image image;
      image.name = std::to_string(i) + ".png";
      image.registered = true;
      const double angle = 0.35 * (i - 1);
      image.pose.rotation = Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitY()).toRotationMatrix() *
                            Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitX()).toRotationMatrix();
      image.pose.translation = {0, 0, 0.5};
      model_.images.push_back(image);
    }
  }

  // Adds marker `id` with its middle at (x, y) on the table, observed by image `i`.
  void put(int i, int id, double x, double y) {
    DetectedMarker marker;
    marker.id = id;
    constexpr double kHalf = kSide / 2;
    const Eigen::Vector2d steps[] = {
        {-kHalf, -kHalf}, {kHalf, -kHalf}, {kHalf, kHalf}, {-kHalf, kHalf}};
    for (std::size_t k = 0; k < 4; ++k) {
      const auto pixel =
          model_.cameras[0].project(model_.images[static_cast<std::size_t>(i)].pose *
                                    Eigen::Vector3d(x + steps[k].x(), y + steps[k].y(), 0));
      marker.corners[k] = {pixel->x, pixel->y};
    }
    seen_[static_cast<std::size_t>(i)].push_back(marker);
  }

  MarkerScale measured(double side = kSide) {
    Model larger = model_;
    for (Image& image : larger.images) image.pose.translation *= kUnit;
    // The grey level of an image identifies it.
    for (int i = 0; i < 3; ++i)
      write_image(path(std::to_string(i) + ".png"),
                  cv::Mat(size_, CV_8UC1, cv::Scalar(static_cast<double>(i))));
    KnownMarkers known;
    known.side = side;
    known.find = [&](const cv::Mat& gray) { return seen_.at(gray.at<std::uint8_t>(0, 0)); };
    NoProgress quiet;
    return marker_scale(larger, [&](const std::string& name) { return path(name); }, known, quiet,
                        {});
  }

  cv::Size size_{640, 480};
  Model model_;
  std::array<std::vector<DetectedMarker>, 3> seen_;
};

TEST_F(MarkerScaleTest, FollowsFromTheKnownSide) {
  for (int i = 0; i < 3; ++i) {
    put(i, 7, -0.04, 0);
    put(i, 12, 0.05, 0.02);
  }
  const MarkerScale scale = measured();
  EXPECT_NEAR(scale.scale, 1 / kUnit, 1e-7);
  EXPECT_EQ(scale.markers, 2);
  EXPECT_EQ(scale.images, 3);
  EXPECT_EQ(scale.left_out, 0);
  EXPECT_LT(scale.spread, 1e-6);
  EXPECT_EQ(to_json(scale)["markers"], 2);
  EXPECT_NEAR(measured(10 * kSide).scale, 10 / kUnit, 1e-6);
}

TEST_F(MarkerScaleTest, AnImageThatShowsTheIdElsewhereIsLeftOut) {
  put(0, 7, -0.04, 0);
  put(1, 7, 0.06, 0.03);  // another marker of the same id
  put(2, 7, -0.04, 0);
  EXPECT_NEAR(measured().scale, 1 / kUnit, 1e-7);
}

TEST_F(MarkerScaleTest, AnIdDetectedTwiceInAnImageIsIgnored) {
  for (int i = 0; i < 3; ++i) {
    put(i, 7, -0.05, 0);
    put(i, 7, 0.05, 0);
    put(i, 3, 0, 0.08);
  }
  EXPECT_EQ(measured().markers, 1);
}

TEST_F(MarkerScaleTest, ThrowsWithoutMarkers) {
  EXPECT_THROW((void)measured(), Error);
  put(0, 7, 0, 0);  // a single image gives no scale
  EXPECT_THROW((void)measured(), Error);
  EXPECT_THROW((void)measured(0), std::invalid_argument);
}

TEST_F(MarkerScaleTest, AnImageOfAnotherSizeIsReported) {
  for (int i = 0; i < 3; ++i) put(i, 7, 0, 0);
  size_.width = 600;
  EXPECT_THROW((void)measured(), InputError);
}

}  // namespace
}  // namespace tarsier::sfm
