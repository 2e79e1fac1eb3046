// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/sensor_image.h"

#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/scene/testing_exif.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <string>

namespace tarsier::sfm {
namespace {

class SensorImage : public FolderTest {
 protected:
  // A file whose pixels are stored unrotated, with this orientation tag for display.
  std::string written(const cv::Mat& stored, int orientation) {
    const std::string file = path("image.jpg");
    const auto bytes = with_orientation(encode_image(".jpg", stored, file), orientation);
    write_file_atomically(file, std::span<const std::uint8_t>(bytes));
    return file;
  }
};

cv::Mat smooth() {
  cv::Mat small(5, 7, CV_8UC3);
  cv::randu(small, 0, 255);
  cv::Mat image;
  cv::resize(small, image, {96, 64}, 0, 0, cv::INTER_CUBIC);
  return image;
}

cv::Mat turned(const cv::Mat& image, int quarters) {
  cv::Mat result = image.clone();
  for (int k = 0; k < quarters; ++k) cv::rotate(result, result, cv::ROTATE_90_CLOCKWISE);
  return result;
}

// For every EXIF orientation, rotating the sensor pixels by the turns gives the displayed image.
TEST_F(SensorImage, IsUprightAfterItsTurns) {
  const cv::Mat stored = smooth();
  for (int orientation = 1; orientation <= 8; ++orientation) {
    SCOPED_TRACE(orientation);
    const std::string file = written(stored, orientation);
    EXPECT_EQ(orientation_of_file(file), orientation);
    const cv::Mat sensor = read_sensor_image(file);
    EXPECT_EQ(sensor.size(), stored.size());
    const cv::Mat upright = read_image(file);
    const cv::Mat by_turns = turned(sensor, quarter_turns_of(orientation));
    ASSERT_EQ(by_turns.size(), upright.size());
    EXPECT_EQ(cv::norm(by_turns, upright, cv::NORM_INF), 0);
    const cv::Mat gray = read_sensor_gray_image(file);
    EXPECT_EQ(gray.type(), CV_8UC1);
    EXPECT_EQ(gray.size(), stored.size());
  }
}

TEST_F(SensorImage, IsTheStoredOneUnlessMirrored) {
  const cv::Mat stored = smooth();
  const cv::Mat plain = read_sensor_image(written(stored, 1));
  for (const int orientation : {3, 6, 8})
    EXPECT_EQ(cv::norm(read_sensor_image(written(stored, orientation)), plain, cv::NORM_INF), 0);
  cv::Mat mirrored;
  cv::flip(plain, mirrored, 1);
  for (const int orientation : {2, 4, 5, 7})
    EXPECT_EQ(cv::norm(read_sensor_image(written(stored, orientation)), mirrored, cv::NORM_INF), 0);
}

TEST(DownDirection, IsTheLowerEdgeOfTheUprightImage) {
  // A bright lower edge, rotated back: its side in the pixels of the sensor.
  for (int turns = 0; turns < 4; ++turns) {
    cv::Mat upright(20, 20, CV_8UC1, cv::Scalar(0));
    upright.row(19) = 255;
    const cv::Mat sensor = turned(upright, (4 - turns) % 4);
    const Eigen::Vector3d down = down_direction(turns);
    const int x = static_cast<int>(9.5 + 9.5 * down.x());
    const int y = static_cast<int>(9.5 + 9.5 * down.y());
    EXPECT_EQ(sensor.at<std::uint8_t>(y, x), 255) << turns;
    EXPECT_EQ(down.z(), 0);
  }
}

}  // namespace
}  // namespace tarsier::sfm
