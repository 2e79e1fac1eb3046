// SPDX-License-Identifier: MIT
#include "tarsier/synth/planar_scene.h"

#include "tarsier/synth/planar_images.h"
#include "tarsier/synth/planar_worlds.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <vector>

namespace tarsier::synth {
namespace {

geometry::Camera camera_of(double focal = 500) {
  geometry::Camera camera;
  camera.width = 320;
  camera.height = 240;
  camera.fx = camera.fy = focal;
  camera.cx = 159.5;
  camera.cy = 119.5;
  return camera;
}

// A camera that looks straight down from `height`, tilted by `tilt` about x.
PlanarShot above_print(double height, double tilt = 0) {
  PlanarShot shot;
  const double c = std::cos(tilt);
  const double s = std::sin(tilt);
  shot.camera_from_world.rotation = Eigen::Matrix3d{{1, 0, 0}, {0, c, -s}, {0, s, c}} *
                                    Eigen::Matrix3d{{1, 0, 0}, {0, -1, 0}, {0, 0, -1}};
  shot.camera_from_world.translation = {0, 0, height};
  return shot;
}

PlanarPrint square_print(double width) {
  PlanarPrint print;
  print.image = cv::Mat(200, 200, CV_8UC1, cv::Scalar(200));
  print.part = {50, 50, 100, 100};
  print.image(cv::Rect(50, 50, 100, 100)).setTo(20);
  print.width = width;
  return print;
}

ImagingConditions clean() {
  ImagingConditions imaging;
  imaging.noise = 0;
  imaging.defocus_px = 0;
  imaging.color = false;
  return imaging;
}

const cv::Mat& gray_ground() {
  static const cv::Mat ground(64, 64, CV_8UC3, cv::Scalar::all(200));
  return ground;
}

// Position of a dark square along a line of the image, from the sum and centroid of its darkness.
// It is exact for any symmetric blur.
cv::Vec2d extent(const cv::Mat& gray, int row) {
  double sum = 0;
  double moment = 0;
  for (int x = 0; x < gray.cols; ++x) {
    const double dark = std::max(0.0, (200.0 - gray.at<uchar>(row, x)) / 180);
    sum += dark;
    moment += dark * x;
  }
  return {moment / sum - 0.5 * sum, moment / sum + 0.5 * sum};
}

TEST(PlanarScene, EdgesMatchTruth) {
  // Magnified, at about the size of its pixels, and from a distance.
  for (const double height : {0.4, 1.1, 3.7}) {
    const PlanarScene scene(camera_of(), {square_print(0.1)}, gray_ground(), 1);
    PlanarShot shot = above_print(height);
    geometry::Rigid3 pose;
    pose.translation = {0.0031, -0.0017, 0};
    shot.world_from_print = {pose};
    const cv::Mat image = scene.render(std::vector{shot}, clean());
    const auto truth = scene.truth(shot);
    ASSERT_EQ(truth.size(), 1U);
    const auto edges = extent(image, 120);
    EXPECT_NEAR(edges[0], truth[0].corners[0].x, 0.05) << height;
    EXPECT_NEAR(edges[1], truth[0].corners[1].x, 0.05) << height;
    EXPECT_NEAR(truth[0].side_px, 500 * 0.1 / height, 1e-9);
    EXPECT_LT(truth[0].corners[0].y, truth[0].corners[3].y);
    EXPECT_DOUBLE_EQ(truth[0].visible, 1);
  }
}

TEST(PlanarScene, MotionBlurDoesNotShiftEdges) {
  const PlanarScene scene(camera_of(), {square_print(0.1)}, gray_ground(), 1);
  PlanarShot middle = above_print(0.5);
  middle.world_from_print = {geometry::Rigid3{}};
  std::vector<PlanarShot> shots;
  for (int k = 0; k < 6; ++k) {
    PlanarShot shot = middle;
    shot.camera_from_world.translation[1] += ((k + 0.5) / 6 - 0.5) * 8 * 0.5 / 500;  // 8 px
    shots.push_back(shot);
  }
  const cv::Mat image = scene.render(shots, clean());
  const auto truth = scene.truth(middle);
  // First the edges parallel to the motion, which stay sharp, then those across it.
  const auto edges = extent(image, 120);
  EXPECT_NEAR(edges[0], truth[0].corners[0].x, 0.15);
  EXPECT_NEAR(edges[1], truth[0].corners[1].x, 0.15);
  const auto down = extent(image.t(), 160);
  EXPECT_NEAR(0.5 * (down[0] + down[1]), 0.5 * (truth[0].corners[0].y + truth[0].corners[3].y),
              0.1);
  // Blurred over 8 px.
  const int y = cvRound(truth[0].corners[0].y);
  EXPECT_GT(image.at<uchar>(y + 3, 160), 25);
  EXPECT_LT(image.at<uchar>(y - 3, 160), 198);
}

TEST(PlanarScene, AntialiasesFineLines) {
  PlanarPrint print;
  print.image = cv::Mat(1024, 1024, CV_8UC1);
  for (int x = 0; x < 1024; ++x) print.image.col(x).setTo(x / 4 % 2 == 0 ? 0 : 200);
  print.width = 1;
  const PlanarScene scene(camera_of(), {print}, gray_ground(), 3);
  for (const double tilt : {0.0, 0.9}) {
    PlanarShot shot = above_print(8, tilt);
    shot.world_from_print = {geometry::Rigid3{}};
    const cv::Mat image = scene.render(std::vector{shot}, clean());
    double low = 0;
    double high = 0;
    cv::minMaxLoc(image(cv::Rect(140, 110, 40, 20)), &low, &high);
    EXPECT_GT(low, 88) << tilt;
    EXPECT_LT(high, 112) << tilt;
  }
}

TEST(PlanarScene, OccludersHideAndLightDims) {
  PlanarPrint cover;
  cover.id = -1;
  cover.image = cv::Mat(16, 16, CV_8UC4, cv::Scalar(120, 120, 120, 255));
  cover.width = 0.05;
  const PlanarScene scene(camera_of(), {square_print(0.1), cover}, gray_ground(), 1);
  PlanarShot shot = above_print(0.5);
  geometry::Rigid3 over;
  over.translation = {0.05, 0.05, 0.001};  // covers a quarter of the width and of the height
  shot.world_from_print = {geometry::Rigid3{}, over};
  const auto truth = scene.truth(shot);
  ASSERT_EQ(truth.size(), 1U);  // the cover has no ground truth
  EXPECT_NEAR(truth[0].visible, 1 - 1.0 / 16, 0.02);
  ImagingConditions imaging = clean();
  const cv::Mat full = scene.render(std::vector{shot}, imaging);
  EXPECT_NEAR(full.at<uchar>(70, 209), 120, 2);
  imaging.gain = 0.5;
  imaging.haze = 10;
  const cv::Mat dim = scene.render(std::vector{shot}, imaging);
  EXPECT_NEAR(dim.at<uchar>(70, 209), 70, 2);
  EXPECT_NEAR(dim.at<uchar>(5, 5), 110, 2);
}

TEST(PlanarScene, AppliesDistortionOfCamera) {
  geometry::Camera camera = camera_of(250);
  camera.distortion = {-0.25, 0.08, 0, 0, 0};
  const PlanarScene scene(camera, {square_print(0.05)}, gray_ground(), 1);
  PlanarShot shot = above_print(0.5);
  geometry::Rigid3 pose;
  pose.translation = {0.2, 0, 0};
  shot.world_from_print = {pose};
  const cv::Mat image = scene.render(std::vector{shot}, clean());
  const auto truth = scene.truth(shot);
  const auto edges = extent(image, 120);
  // At the height of the middle, the edge is less far inside than at its corners.
  const auto left = camera.project({0.175, 0, 0.5});
  EXPECT_NEAR(edges[0], left->x, 0.1);
  EXPECT_LT(truth[0].corners[0].x, 159.5 + 250 * 0.175 / 0.5 - 2);
}

TEST(PlanarScene, RejectsInvalidInput) {
  const PlanarScene scene(camera_of(), {square_print(0.1)}, gray_ground(), 1);
  EXPECT_THROW((void)scene.render({}, clean()), std::invalid_argument);
  EXPECT_THROW((void)scene.render(std::vector{above_print(1)}, clean()), std::invalid_argument);
  ImagingConditions imaging;
  imaging.noise = -1;
  EXPECT_THROW(imaging.check(), std::invalid_argument);
}

TEST(PlanarWorlds, StillsAreReproducible) {
  const auto& family = planar::markers::find_dictionary("36h11");
  StillOptions options;
  options.min_prints = 3;
  const PlanarStill a = marker_still(family, 0.1, options, PlanarLevel::kHard, 5);
  cv::setNumThreads(1);
  const PlanarStill b = marker_still(family, 0.1, options, PlanarLevel::kHard, 5);
  cv::setNumThreads(-1);
  EXPECT_EQ(cv::norm(a.image, b.image, cv::NORM_INF), 0);
  ASSERT_GE(a.truth.size(), 2U);
  for (const PrintTruth& truth : a.truth) {
    EXPECT_GT(truth.facing, std::cos(64 * CV_PI / 180));
    EXPECT_GT(truth.visible, 0.99);
    // Its corners are those of the pose.
    const auto corner = a.camera.project(truth.camera_from_print * Eigen::Vector3d(-0.05, 0.05, 0));
    EXPECT_NEAR(cv::norm(*corner - truth.corners[0]), 0, 1e-9);
  }
  const PlanarStill other = marker_still(family, 0.1, options, PlanarLevel::kHard, 6);
  EXPECT_GT(cv::norm(a.image, other.image, cv::NORM_INF), 20);
}

TEST(PlanarWorlds, VideosHaveRequestedSpeedAndRest) {
  const auto& family = planar::markers::find_dictionary("orig");
  VideoOptions options;
  options.size = {320, 240};
  options.speed_px = 12;
  const PlanarVideo video = marker_video(family, 2, 0.05, options);
  double most = 0;
  double tilt = 0;
  for (int i = 0; i < 1500; ++i) {
    const auto a = video.truth_at(i / 25.0);
    const auto b = video.truth_at((i + 1) / 25.0);
    if (a.empty() || b.empty()) continue;
    double moved = 0;
    for (std::size_t k = 0; k < 4; ++k)
      moved = std::max(moved, cv::norm(a[0].corners[k] - b[0].corners[k]));
    most = std::max(most, moved);
    tilt = std::max(tilt, std::acos(a[0].facing));
    if (PlanarVideo::is_at_rest(i / 25.0) && PlanarVideo::is_at_rest((i + 1) / 25.0)) {
      EXPECT_EQ(moved, 0) << i;
    }
  }
  EXPECT_GT(most, 3);
  EXPECT_LE(most, 12.01);
  EXPECT_GT(tilt, 30 * CV_PI / 180);
  EXPECT_EQ(video.image_at(1).size(), options.size);
}

TEST(PlanarWorlds, TruthLinesHaveTheirHomography) {
  PlanarPrint poster;
  poster.id = 7;
  poster.name = "poster";
  poster.image = poster_image({300, 200}, 3);
  poster.width = 0.3;
  const std::vector<PlanarPrint> prints{poster};
  const PlanarStill still = print_still(prints, {}, PlanarLevel::kEasy, 4);
  TruthLine line;
  line.image = "a.png";
  line.targets = true;
  const auto json = nlohmann::json::parse(truth_line(line, still, prints));
  ASSERT_EQ(json["markers"].size(), 1U);
  const auto& marker = json["markers"][0];
  const auto h = marker["H"].get<std::vector<double>>();
  // The image's corner is half a pixel outside the centre of its first pixel.
  const double w = h[6] * -0.5 + h[7] * -0.5 + h[8];
  EXPECT_NEAR((h[0] * -0.5 + h[1] * -0.5 + h[2]) / w, marker["corners"][0][0].get<double>(), 1e-6);
  EXPECT_NEAR((h[3] * -0.5 + h[4] * -0.5 + h[5]) / w, marker["corners"][0][1].get<double>(), 1e-6);
}

}  // namespace
}  // namespace tarsier::synth
