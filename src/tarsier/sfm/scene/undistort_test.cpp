// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/undistort.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/scene/testing_model.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

namespace tarsier::sfm {
namespace {

geometry::Camera barrel() {
  return {640, 480, 500, 510, 310, 245, {-0.2, 0.04, 1e-3, -1e-3, 0}, 0};
}
geometry::Camera pincushion() {
  return {640, 480, 500, 510, 330, 235, {0.15, 0.02, -1e-3, 2e-3, 0.01}, 0};
}

TEST(UndistortedCamera, SeesNothingOutsideOfTheSource) {
  for (const geometry::Camera& from : {barrel(), pincushion()}) {
    const geometry::Camera to = undistorted_camera(from);
    EXPECT_FALSE(to.is_distorted());
    EXPECT_EQ(to.width, from.width);
    EXPECT_EQ(to.height, from.height);
    double nearest = 1e9;
    const auto check = [&](int x, int y) {
      const cv::Point2d source = from.pixel_of(*to.normalized_of(cv::Point2d(x, y)));
      const double margin =
          std::min({source.x, source.y, from.width - 1 - source.x, from.height - 1 - source.y});
      EXPECT_GT(margin, -0.01) << x << " " << y;
      nearest = std::min(nearest, margin);
    };
    for (int x = 0; x < to.width; ++x) {
      check(x, 0);
      check(x, to.height - 1);
    }
    for (int y = 0; y < to.height; ++y) {
      check(0, y);
      check(to.width - 1, y);
    }
    EXPECT_LT(nearest, 0.05);  // no more than necessary is cut off
  }
}

TEST(UndistortedCamera, IsTheSameWithoutDistortion) {
  geometry::Camera camera = barrel();
  camera.distortion = {};
  const geometry::Camera same = undistorted_camera(camera);
  EXPECT_EQ(same.fx, camera.fx);
  EXPECT_EQ(same.cx, camera.cx);
  const cv::Mat pixels(480, 640, CV_8UC3, cv::Scalar(1, 2, 3));
  const cv::Mat copy = undistort_image(pixels, camera, same);
  EXPECT_EQ(cv::norm(pixels, copy, cv::NORM_INF), 0);
  EXPECT_NE(copy.data, pixels.data);
}

TEST(UndistortedCamera, RefusesDistortionThatIsNotInvertible) {
  geometry::Camera camera = barrel();
  camera.distortion = {-2, 0, 0, 0, 0};  // the radius turns inside the image
  EXPECT_THROW((void)undistorted_camera(camera), Error);
  camera.fx = 0;
  EXPECT_THROW((void)undistorted_camera(camera), std::invalid_argument);
}

TEST(UndistortedModel, ReprojectsToItsFeatures) {
  const Model before = synthetic_model();
  const Model after = undistorted_model(before);
  ASSERT_EQ(after.points.size(), before.points.size());
  int checked = 0;
  for (const Point& point : after.points) {
    for (const auto& [i, f] : point.track) {
      const Image& image = after.images[static_cast<std::size_t>(i)];
      const geometry::Camera& camera = after.cameras[static_cast<std::size_t>(image.camera)];
      EXPECT_FALSE(camera.is_distorted());
      const auto pixel = camera.project(image.pose * point.position);
      ASSERT_TRUE(pixel);
      EXPECT_NEAR(pixel->x, image.features[static_cast<std::size_t>(f)].x, 1e-3);
      EXPECT_NEAR(pixel->y, image.features[static_cast<std::size_t>(f)].y, 1e-3);
      ++checked;
    }
  }
  EXPECT_GT(checked, 200);
}

TEST(UndistortedModel, RefusesAFeatureFarOutside) {
  Model model = synthetic_model();
  model.cameras[1].distortion = {-0.2, 0, 0, 0, 0};
  model.images[4].features[0] = {1e7F, 1e7F};
  EXPECT_THROW((void)undistorted_model(model), Error);
  model.images[4].camera = 3;
  EXPECT_THROW((void)undistorted_model(model), std::invalid_argument);
}

// White background with dark lines that are straight without distortion, as `from` images it.
cv::Mat distorted_grid(const geometry::Camera& from, const geometry::Camera& to, int spacing) {
  cv::Mat pixels(from.height, from.width, CV_8UC1);
  for (int v = 0; v < from.height; ++v) {
    for (int u = 0; u < from.width; ++u) {
      const cv::Point2d pixel = to.pixel_of(*from.normalized_of(cv::Point2d(u, v)));
      const double dx = std::abs(std::remainder(pixel.x, spacing));
      const double dy = std::abs(std::remainder(pixel.y, spacing));
      const double dark = std::exp(-std::min(dx, dy) * std::min(dx, dy) / (2 * 1.5 * 1.5));
      pixels.at<unsigned char>(v, u) = static_cast<unsigned char>(std::lround(255 - 200 * dark));
    }
  }
  return pixels;
}

TEST(UndistortImage, MakesLinesStraightAndBordersFull) {
  constexpr int kSpacing = 40;
  for (const geometry::Camera& from : {barrel(), pincushion()}) {
    const geometry::Camera to = undistorted_camera(from);
    const cv::Mat bent = distorted_grid(from, to, kSpacing);
    const cv::Mat straight = undistort_image(bent, from, to);
    ASSERT_EQ(straight.size(), cv::Size(to.width, to.height));
    double low = 0;
    cv::minMaxLoc(straight, &low);
    EXPECT_GT(low, 30);  // black would be a border; the lines have 55
    // For each vertical line: the centroid of its darkness in each row between the horizontal
    // lines.
    for (int x = kSpacing; x + kSpacing < to.width; x += kSpacing) {
      for (int y = kSpacing / 2; y < to.height; y += kSpacing) {
        double sum = 0;
        double weight = 0;
        for (int u = x - 8; u <= x + 8; ++u) {
          const double dark = 255 - straight.at<unsigned char>(y, u);
          sum += dark * u;
          weight += dark;
        }
        EXPECT_NEAR(sum / weight, x, 0.1) << x << " " << y;
      }
    }
    const cv::Mat full(from.height, from.width, CV_8UC3, cv::Scalar(200, 100, 50));
    const cv::Mat still_full = undistort_image(full, from, to);
    EXPECT_EQ(cv::norm(still_full, full, cv::NORM_INF), 0);
  }
}

TEST(UndistortImage, RefusesInconsistentSizes) {
  const geometry::Camera from = barrel();
  const cv::Mat pixels(480, 640, CV_8UC1, cv::Scalar(7));
  EXPECT_THROW((void)undistort_image(pixels, from, from), std::invalid_argument);
  EXPECT_THROW((void)undistort_image(pixels.t(), from, undistorted_camera(from)),
               std::invalid_argument);
  EXPECT_THROW((void)undistort_image({}, from, undistorted_camera(from)), std::invalid_argument);
}

class ExportTest : public FolderTest {
 protected:
  void SetUp() override {
    model_.images[0].name = "folder/photo 0.PNG";
    reader_ = [this](const std::string& name) {
      ++read_;
      for (const Image& image : model_.images) {
        if (image.name != name) continue;
        const geometry::Camera& camera = model_.cameras[static_cast<std::size_t>(image.camera)];
        return cv::Mat(camera.height, camera.width, CV_8UC3, cv::Scalar(10, 20, 200));
      }
      return cv::Mat();
    };
  }
  void run(const std::stop_token& stop = {}) {
    NoProgress progress;
    export_undistorted(path("dense"), model_, reader_, progress, stop);
  }

  Model model_ = synthetic_model();
  std::function<cv::Mat(const std::string&)> reader_;
  int read_ = 0;
};

TEST_F(ExportTest, WritesTheFormatOfDenseTools) {
  run();
  EXPECT_EQ(read_, 4);
  const Model back = read_colmap(path("dense/sparse"));
  EXPECT_EQ(back.images.size(), 4U);
  EXPECT_EQ(back.points.size(), model_.points.size());
  const std::string cameras = contents(path("dense/sparse/cameras.txt"));
  EXPECT_NE(cameras.find(" PINHOLE 640 480 "), std::string::npos);
  EXPECT_EQ(cameras.find("OPENCV"), std::string::npos);
  for (const Image& image : back.images) {
    const cv::Mat pixels = read_image(path("dense/images/" + image.name));
    const geometry::Camera& camera = back.cameras[static_cast<std::size_t>(image.camera)];
    EXPECT_EQ(pixels.size(), cv::Size(camera.width, camera.height));
    EXPECT_LE(
        cv::norm(pixels, cv::Mat(pixels.size(), CV_8UC3, cv::Scalar(10, 20, 200)), cv::NORM_INF),
        4);
  }
  EXPECT_EQ(contents(path("dense/images/folder/photo 0.PNG")).substr(1, 3), "PNG");
  EXPECT_EQ(contents(path("dense/images/folder/photo 2.jpg")).substr(0, 2), "\xFF\xD8");
  EXPECT_FALSE(std::filesystem::exists(path("dense/images/folder/photo 1.jpg")));
}

TEST_F(ExportTest, WritesNothingForBadNames) {
  for (const std::string name :
       {"../evil.jpg", "a.tif", "folder/./photo 2.jpg", "", "/tmp/a.jpg"}) {
    model_.images[3].name = name;
    EXPECT_THROW(run(), OutputError) << name;
    EXPECT_EQ(files(), 0U) << name;
  }
  EXPECT_EQ(read_, 0);
}

TEST_F(ExportTest, RefusesAnImageOfAnotherSize) {
  reader_ = [](const std::string&) { return cv::Mat(10, 20, CV_8UC3, cv::Scalar()); };
  EXPECT_THROW(run(), InputError);
  reader_ = [](const std::string&) { return cv::Mat(); };
  EXPECT_THROW(run(), InputError);
}

TEST_F(ExportTest, Stops) {
  std::stop_source source;
  source.request_stop();
  EXPECT_THROW(run(source.get_token()), Interrupted);
  EXPECT_EQ(files(), 0U);
}

}  // namespace
}  // namespace tarsier::sfm
