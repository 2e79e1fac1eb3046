// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/board.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/planar/markers/testing_pose.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace tarsier::planar::markers {
namespace {

using ::testing::HasSubstr;

TEST(MarkerBoard, IsMoreAccurateThanItsMarkers) {
  const geometry::Camera camera = test_camera();
  const geometry::Rigid3 truth{
      Eigen::Matrix3d{
          {1, 0, 0}, {0, -std::cos(0.5), -std::sin(0.5)}, {0, std::sin(0.5), -std::cos(0.5)}},
      {0.01, 0.02, 0.6}};
  std::vector<BoardMarker> board;
  std::vector<Marker> markers;
  for (int id = 0; id < 6; ++id) {
    const BoardMarker place{
        id, {0.05 * (id % 3) - 0.05, 0.05 * (id / 3)}, id == 2 ? 1.0 : 0.0, 0.04};
    board.push_back(place);
    const geometry::Rigid3 on_board{geometry::rotation_by({0, 0, place.rotation}),
                                    {place.center.x, place.center.y, 0}};
    Marker marker;
    marker.id = id;
    marker.corners = seen(truth * on_board, 0.04, camera);
    for (std::size_t k = 0; k < 4; ++k)
      marker.corners[k] += Eigen::Vector2d(0.3 * std::sin(7 * id + 3.0 * static_cast<double>(k)),
                                           0.3 * std::cos(5 * id + 2.0 * static_cast<double>(k)));
    markers.push_back(marker);
  }
  const auto pose = pose_of_board(markers, board, camera);
  ASSERT_TRUE(pose);
  const double together = degrees_between(pose->camera_from_marker, truth);
  EXPECT_LT(together, 0.7);
  double worst = 0;
  for (const Marker& marker : markers) {
    const auto alone = pose_of_marker(marker, 0.04, camera);
    if (marker.id != 2) worst = std::max(worst, degrees_between(alone->camera_from_marker, truth));
  }
  EXPECT_GT(worst, 2 * together);
  EXPECT_FALSE(pose_of_board({}, board, camera));
}

TEST(MarkerBoard, IsTrackedWhileMarkersAreHidden) {
  const geometry::Camera camera = test_camera();
  const std::vector<BoardMarker> board{{0, {-0.05, 0}, 0, 0.04}, {1, {0.05, 0}, 0, 0.04}};
  BoardTrack track;
  for (int i = 0; i < 8; ++i) {
    const geometry::Rigid3 truth{kFacing, {0.002 * i, 0, 0.5}};
    std::vector<Marker> markers;
    for (const BoardMarker& place : board) {
      if (i == 4 && place.id == 0) continue;  // hidden
      Marker marker;
      marker.id = place.id;
      marker.corners =
          seen({truth.rotation, truth * Eigen::Vector3d(place.center.x, place.center.y, 0)},
               place.size, camera);
      markers.push_back(marker);
    }
    const auto pose = track_board(markers, board, camera, 0.04 * i, {}, track);
    ASSERT_TRUE(pose) << i;
    EXPECT_LT((pose->camera_from_marker.translation - truth.translation).norm(), 0.001) << i;
  }
  EXPECT_FALSE(track_board({}, board, camera, 1, {}, track));
}

TEST(MarkerBoard, FileRoundTrips) {
  const TemporaryFolder folder;
  const MarkerBoard board{"36h11", {{3, {0.1, -0.2}, 0.5, 0.04}, {7, {0, 0}, 0, 0.05}}};
  write_marker_board(folder / "board.json", board);
  const MarkerBoard read = read_marker_board(folder / "board.json");
  EXPECT_EQ(read.family, "36h11");
  ASSERT_EQ(read.markers.size(), 2U);
  EXPECT_EQ(read.markers[0].id, 3);
  EXPECT_EQ(read.markers[0].center, cv::Point2d(0.1, -0.2));
  EXPECT_NEAR(read.markers[0].rotation, 0.5, 1e-12);
  EXPECT_EQ(read.markers[1].size, 0.05);
}

TEST(MarkerBoard, ErrorNamesFileAndReason) {
  const auto reason = [](const std::string& text) -> std::string {
    try {
      (void)parse_marker_board(text, "b.json");
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  };
  const auto with = [&](const std::string& markers) {
    return reason(R"({"family": "36h11", "markers": [)" + markers + "]}");
  };
  EXPECT_EQ(with(R"({"id": 0, "center": [0, 0], "size": 0.1})"), "");
  EXPECT_THAT(with(""), HasSubstr("b.json: a board without markers"));
  EXPECT_THAT(with(R"({"id": 900, "center": [0, 0], "size": 0.1})"), HasSubstr("no marker 900"));
  EXPECT_THAT(with(R"({"id": 0, "center": [0], "size": 0.1})"), HasSubstr("not a board"));
  EXPECT_THAT(with(R"({"id": 0, "center": [0, 0], "size": 0})"), HasSubstr("0 m wide"));
  EXPECT_THAT(with(R"({"id": 0, "center": [0, 1e9], "size": 1})"), HasSubstr("at (0, 1"));
  EXPECT_THAT(
      with(R"({"id": 0, "center": [0, 0], "size": 1},{"id": 0, "center": [2, 0], "size": 1})"),
      HasSubstr("twice"));
  EXPECT_THAT(reason(R"({"family": "9x9", "markers": []})"), HasSubstr("9x9"));
  EXPECT_THAT(reason("[1, 2]"), HasSubstr("not a board"));
  EXPECT_THAT(reason("no json"), HasSubstr("b.json"));
}

}  // namespace
}  // namespace tarsier::planar::markers
