// SPDX-License-Identifier: MIT
#include "tarsier/sfm/consistency/pair_agreement.h"

#include <gtest/gtest.h>
#include <opencv2/calib3d.hpp>

#include <cmath>
#include <vector>

namespace tarsier::sfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Two images of 8 x 6 points, 4 units in front of the first. `depth` gives each point's offset in
// front of that wall.
struct TwoImages {
  Model model;
  Pair pair;

  template <typename Depth>
  explicit TwoImages(const Depth& depth) {
    model.cameras = {{.width = 640, .height = 480, .fx = 600, .fy = 600, .cx = 320, .cy = 240}};
    model.images.resize(2);
    for (Image& image : model.images) image.registered = true;
    model.images[1].pose = {geometry::rotation_by({0.02, -0.4, 0.01}), {1.4, 0.1, 0.3}};
    std::vector<Match> inliers;
    for (int i = 0; i < 48; ++i) {
      const Vector3d point(0.35 * (i % 8) - 1.2, 0.4 * (i / 8) - 1, 4 + 0.2 * (i % 8) - depth(i));
      for (Image& image : model.images) {
        const auto pixel = model.cameras[0].project(image.pose * point);
        image.features.emplace_back(*pixel);
      }
      inliers.push_back({i, i});
    }
    pair.view.inliers = std::move(inliers);
    pair.first = 0;
    pair.second = 1;
    pair.view.homography_inliers = 48;
    pair.view.second_from_first = model.images[1].pose;
    pair.view.second_from_first.translation.normalize();
    pair.view.median_angle = 0.3;
  }
  // The wrong one of the two poses from a homography of the matches.
  [[nodiscard]] geometry::Rigid3 other_pose() const {
    const cv::Mat h = cv::findHomography(model.images[0].features, model.images[1].features);
    const cv::Matx33d k(600, 0, 320, 0, 600, 240, 0, 0, 1);
    std::vector<cv::Mat> rotations, translations, normals;
    cv::decomposeHomographyMat(h, k, rotations, translations, normals);
    for (std::size_t s = 0; s < rotations.size(); ++s) {
      geometry::Rigid3 pose;
      for (int r = 0; r < 3; ++r) {
        pose.translation[r] = translations[s].at<double>(r);
        for (int c = 0; c < 3; ++c) pose.rotation(r, c) = rotations[s].at<double>(r, c);
      }
      const double off =
          geometry::angle_of(pose.rotation * model.images[1].pose.rotation.transpose());
      if (off > 0.1 && normals[s].at<double>(2) > 0) return pose;
    }
    ADD_FAILURE() << "one pose only";
    return {};
  }
};

double flat(int /*point*/) { return 0; }
double uneven(int point) { return 0.5 * (point % 3) + 0.3 * (point % 5); }

TEST(PairAgreement, ComparesRelativePoses) {
  TwoImages images(uneven);
  images.pair.view.homography_inliers = 20;
  EXPECT_TRUE(agrees(images.model, images.pair));
  Model turned = images.model;
  turned.images[1].pose.rotation =
      geometry::rotation_by({0.08, 0, 0}) * turned.images[1].pose.rotation;
  EXPECT_FALSE(agrees(turned, images.pair));
  Model beside = images.model;
  beside.images[1].pose.translation = {0.3, 1, 0.3};
  EXPECT_FALSE(agrees(beside, images.pair));
  images.pair.view.median_angle = 0.01;  // the direction is poorly determined
  EXPECT_TRUE(agrees(beside, images.pair));
}

TEST(PairAgreement, AcceptsPosesThatExplainMatches) {
  TwoImages images(uneven);
  images.pair.view.homography_inliers = 20;
  // The pair has another pose than the model, but its matches agree with the model.
  Pair& pair = images.pair;
  pair.view.second_from_first = {geometry::rotation_by({0, -0.6, 0.1}), {1, 0.6, 0}};
  EXPECT_EQ(explained_matches(images.model, pair, 0.01), 48);
  EXPECT_TRUE(agrees(images.model, pair));
  Model moved = images.model;
  for (std::size_t k = 0; k < 4; ++k) moved.images[1].features[12 * k].y += 30;
  EXPECT_EQ(explained_matches(moved, pair, 2), 44);
  EXPECT_TRUE(agrees(moved, pair));
  for (std::size_t k = 0; k < 8; ++k) moved.images[1].features[1 + 6 * k].y -= 30;
  EXPECT_EQ(explained_matches(moved, pair, 2), 36);
  EXPECT_FALSE(agrees(moved, pair));
  pair.view.inliers = {};  // no matches to explain
  EXPECT_FALSE(agrees(images.model, pair));
}

TEST(PairAgreement, RejectsPointsBehindCamera) {
  TwoImages images(uneven);
  images.pair.view.homography_inliers = 20;
  Model behind = images.model;  // the same epipolar lines
  behind.images[1].pose.translation *= -1;
  EXPECT_EQ(explained_matches(behind, images.pair, 2), 0);
  EXPECT_FALSE(agrees(behind, images.pair));
}

TEST(PairAgreement, AcceptsBothPosesOfPlane) {
  TwoImages images(flat);
  images.pair.view.second_from_first = images.other_pose();
  EXPECT_TRUE(agrees(images.model, images.pair));
  // A fifth of the matches are wrong.
  for (std::size_t k = 0; k < 48; k += 5) images.model.images[1].features[k].y += 30;
  EXPECT_TRUE(agrees(images.model, images.pair));
}

TEST(PairAgreement, RejectsOtherPosesOfPlane) {
  TwoImages images(flat);
  images.pair.view.second_from_first = images.other_pose();
  Model folded = images.model;
  folded.images[1].pose = {geometry::rotation_by({0, 1.2, 0}), {-4, 0, 2}};
  EXPECT_FALSE(agrees(folded, images.pair));
  folded.images[1].pose = images.model.images[1].pose;
  folded.images[1].pose.translation = {0.2, 1.4, 0.3};
  EXPECT_FALSE(agrees(folded, images.pair));
  folded.images[1].pose.translation.setZero();
  EXPECT_FALSE(agrees(folded, images.pair));
}

TEST(PairAgreement, RejectsSecondPoseForNonPlanarPoints) {
  TwoImages images(uneven);
  TwoImages wall(flat);
  Model other = images.model;  // the second pose of a plane; these points do not lie on one
  other.images[1].pose = wall.other_pose();
  EXPECT_FALSE(agrees(other, images.pair));
  images.pair.view.homography_inliers = 20;
  EXPECT_FALSE(agrees(other, images.pair));
}

}  // namespace
}  // namespace tarsier::sfm
