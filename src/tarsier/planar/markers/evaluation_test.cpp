// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/evaluation.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>

namespace tarsier::planar::markers {
namespace {

MarkerRecord marker_at(int id, double x, double y, double side) {
  MarkerRecord marker;
  marker.id = id;
  marker.corners = {cv::Point2d(x, y), {x + side, y}, {x + side, y + side}, {x, y + side}};
  marker.side_px = side;
  geometry::Rigid3 pose;
  pose.translation = {0, 0, 2};
  marker.pose = pose;
  return marker;
}

TEST(MarkerEvaluator, CountsPositivesAndRotatedMarkers) {
  MarkerTruth truth;
  truth.level = "easy";
  truth.markers = {marker_at(1, 10, 10, 40), marker_at(2, 100, 10, 40), marker_at(3, 200, 10, 40)};
  MarkerRecord exact = marker_at(1, 10.3, 10.4, 40);
  exact.pose->translation = {0, 0, 2.1};
  MarkerRecord turned = marker_at(2, 100, 10, 40);
  std::rotate(turned.corners.begin(), turned.corners.begin() + 1, turned.corners.end());
  // More than a fifth of its side away.
  const MarkerRecord elsewhere = marker_at(3, 215, 10, 40);
  const MarkerRecord again = marker_at(1, 10, 10, 40);  // the true marker was already found
  MarkerEvaluator evaluator;
  evaluator.add(truth, std::vector<MarkerRecord>{exact, turned, elsewhere, again}, 4.0);
  evaluator.add({}, {}, 2.0);
  const MarkerScore score = evaluator.score();
  EXPECT_EQ(score.images, 2);
  EXPECT_EQ(score.truth, 3);
  EXPECT_EQ(score.true_positives, 1);
  EXPECT_EQ(score.false_positives, 3);
  EXPECT_EQ(score.rotated, 1);
  EXPECT_NEAR(score.corner_px, 0.5, 1e-9);
  EXPECT_NEAR(score.distance_percent, 5, 1e-9);
  EXPECT_EQ(score.flips_percent, 0);
  EXPECT_NEAR(score.ms, 3, 1e-9);
  EXPECT_EQ(score.levels.at("easy"), (std::pair{1, 3}));
}

TEST(MarkerTruth, IsParsedAndErrorsNameTheLine) {
  const TemporaryFolder folder;
  const std::string path = folder / "truth.jsonl";
  const std::string good =
      R"({"image":"a.png","family":"orig","K":[500,0,320,0,500,240,0,0,1],"dist":[0.1,0,0,0,0],)"
      R"("size":0.05,"level":"easy","markers":[{"id":4,"corners":[[1,2],[3,4],[5,6],[7,8]],)"
      R"("rvec":[0,0,0.1],"tvec":[0,0,1],"side_px":33}]})";
  std::ofstream(path) << good << "\n\n" << good << "\n";
  const auto truth = read_marker_truth(path);
  ASSERT_EQ(truth.size(), 2U);
  EXPECT_EQ(truth[0].camera.fx, 500);
  EXPECT_EQ(truth[0].camera.distortion[0], 0.1);
  ASSERT_EQ(truth[0].markers.size(), 1U);
  EXPECT_EQ(truth[0].markers[0].id, 4);
  EXPECT_EQ(truth[0].markers[0].corners[2], cv::Point2d(5, 6));
  ASSERT_TRUE(truth[0].markers[0].pose);
  for (
      const std::string bad :
      {"{", "[]", R"({"image":"a.png"})", R"({"image":7})",
       R"({"image":"a","family":"orig","K":[1,2],"markers":[]})",
       R"({"image":"a","family":"orig","K":[0,0,0,0,0,0,0,0,1],"markers":[]})",
       R"({"image":"a","family":"orig","K":[1,0,0,0,1,0,0,0,1],"markers":[{"id":-1}]})",
       R"({"image":"a","family":"orig","K":[1,0,0,0,1,0,0,0,1],"markers":[{"id":1,"corners":[]}]})"}) {
    std::ofstream(path) << good << "\n" << bad << "\n";
    try {
      (void)read_marker_truth(path);
      FAIL() << bad;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("line 2"), std::string::npos) << error.what();
    }
  }
  // Parsing a line of brackets takes forty times its size.
  std::ofstream(path) << R"({"image":"a","family":"orig","K":[1,0,0,0,1,0,0,0,1],"markers":[],"x":)"
                      << std::string(500, '[') << std::string(500, ']') << "}\n";
  EXPECT_THROW((void)read_marker_truth(path), InputError);
  std::ofstream(path, std::ios::trunc).close();
  EXPECT_THROW((void)read_marker_truth(path), InputError);
  EXPECT_THROW((void)read_marker_truth(folder / "none"), InputError);
}

TEST(DetectedMarkers, MayHaveNoPoses) {
  const TemporaryFolder folder;
  const std::string path = folder / "found.jsonl";
  std::ofstream(path) << R"({"image":"a.png","markers":[{"id":4,"corners":[[1,2],[3,4],[5,6],)"
                      << R"([7,8]],"rvec":null,"tvec":null}],"ms":1.5})";
  const auto found = read_detected_markers(path);
  EXPECT_FALSE(found.at("a.png").markers.at(0).pose);
  EXPECT_EQ(found.at("a.png").ms, 1.5);
}

}  // namespace
}  // namespace tarsier::planar::markers
