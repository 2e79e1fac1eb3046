// SPDX-License-Identifier: MIT
#include "tarsier/face/head/train_head.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/testing_long.h"
#include "tarsier/face/head/factorization.h"
#include "tarsier/face/head/testing_head.h"
#include "tarsier/face/shape/import.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <string>

namespace tarsier::face::head {
namespace {

using Eigen::Matrix2Xd;
using Eigen::Matrix3Xd;
using Eigen::VectorXd;

struct Images {
  std::vector<Matrix2Xd> faces;
  std::vector<HeadAngles> angles;
};

// Images of other people, each from 1.5 m.
Images image(const HeadModel& model, int count, double noise_px, std::uint64_t seed) {
  Rng rng(seed);
  geometry::Camera camera = testing_camera();
  camera.fx = camera.fy = 2000;
  Images result;
  for (int k = 0; k < count; ++k) {
    VectorXd b(model.mode_count());
    for (Eigen::Index i = 0; i < b.size(); ++i) b[i] = model.deviation[i] * rng.normal();
    HeadAngles angles;
    angles.yaw_deg = rng.normal(0, 20);
    angles.pitch_deg = rng.normal(0, 8);
    angles.roll_deg = rng.normal(0, 8);
    const geometry::Rigid3 pose{rotation_of_angles(angles), {0, 0, 1500}};
    result.faces.push_back(image_of(shape_of(model, b), pose, camera, noise_px, rng));
    result.angles.push_back(angles);
  }
  return result;
}

shape::Markup markup_of(const HeadModel& model) {
  shape::Markup markup;
  markup.mirror = model.mirror;
  markup.outer_eyes = model.outer_eyes;
  markup.connections = model.connections;
  return markup;
}

TrainHeadOptions quick() {
  TrainHeadOptions options;
  options.modes = 3;
  options.iterations = 60;
  return options;
}

TEST(Factorization, IsExactForARigidSymmetricObjectInScaledOrthography) {
  const HeadModel model = testing_head(0);
  Rng rng(1);
  std::vector<Matrix2Xd> faces;
  std::vector<Eigen::Matrix3d> rotations;
  for (int k = 0; k < 40; ++k) {
    const double yaw = rng.uniform(-40, 40);
    const Eigen::Matrix3d r =
        rotation_of_angles({yaw, (k % 2 == 0 ? 1 : -1) * 5.0 * (k / 2 % 4), 7});
    Matrix2Xd face(2, 25);
    for (Eigen::Index i = 0; i < 25; ++i) {
      const Eigen::Vector3d x = r * model.mean.col(i);
      face.col(i) << 3 + 0.02 * x[0], 5 + 0.02 * x[1];
    }
    faces.push_back(face);
    rotations.push_back(r);
  }
  const auto found = factorize_symmetric(faces, model.mirror);
  ASSERT_TRUE(found);
  EXPECT_LT(aligned_error(found->shape, model.mean), 1e-6);
  // The nose points to the front: an exact similarity, no reflection (umeyama never returns one).
  EXPECT_LT(found->shape(2, 22), found->shape(2, 0));
  // Rotations between views are proper rotations.
  const Eigen::Matrix3d turn = found->cameras[5].rotation * found->cameras[0].rotation.transpose();
  const Eigen::Matrix3d truth = rotations[5] * rotations[0].transpose();
  EXPECT_LT((turn - truth).norm(), 1e-6);
}

TEST(TrainHead, RecoversTheHeadOfTheImages) {
  const HeadModel truth = testing_head(3);
  const Images images = image(truth, 400, 0.5, 2);
  const TrainedHead trained = train_head(images.faces, markup_of(truth), quick());
  const HeadModel& model = trained.model;
  EXPECT_LT(aligned_error(model.mean, truth.mean), 1.5);
  EXPECT_EQ(model.trained_on, 400);
  EXPECT_EQ(model.mode_count(), 3);
  EXPECT_NEAR((model.mean.col(0) - model.mean.col(1)).norm(), 89, 1e-6);
  EXPECT_LT((model.mean.col(0) + model.mean.col(1)).norm(), 1e-6);  // the origin
  EXPECT_LT(model.mean(2, 22), -10);                                // the nose is in front
  // The head is upright and faces the camera like the median face.
  const Eigen::Vector3d down = model.mean.col(24) - model.mean.col(22);
  EXPECT_GT(down[1], 40);
  double yaw = 0;
  double pitch = 0;
  for (std::size_t f = 0; f < images.angles.size(); ++f) {
    yaw += std::abs(trained.angles[f].yaw_deg - images.angles[f].yaw_deg) / 400;
    pitch += std::abs(trained.angles[f].pitch_deg - images.angles[f].pitch_deg) / 400;
  }
  EXPECT_LT(yaw, 2.5);
  EXPECT_LT(pitch, 3.5);
  // Its modes span those of the ground truth, except for components of pose.
  const Eigen::MatrixXd left = truth.modes - model.modes * (model.modes.transpose() * truth.modes);
  EXPECT_LT(left.col(0).norm(), 0.3);
  EXPECT_NEAR(model.deviation[0] / truth.deviation[0], 1, 0.25);
}

TEST(TrainHead, IsTheSameForAnyNumberOfThreadsAndLeavesOutIncompleteFaces) {
  const HeadModel truth = testing_head(3);
  Images images = image(truth, 60, 0.5, 3);
  TrainHeadOptions options = quick();
  options.iterations = 15;
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const TrainedHead one = train_head(images.faces, markup_of(truth), options);
  cv::setNumThreads(4);
  images.faces.insert(images.faces.begin() + 7, images.faces[0]);
  images.faces[7](1, 3) = std::numeric_limits<double>::quiet_NaN();
  const TrainedHead four = train_head(images.faces, markup_of(truth), options);
  cv::setNumThreads(threads);
  EXPECT_EQ(one.model.mean, four.model.mean);
  EXPECT_EQ(one.model.modes, four.model.modes);
  EXPECT_EQ(four.angles[7].yaw_deg, 0);
  EXPECT_EQ(one.angles[7].yaw_deg, four.angles[8].yaw_deg);
}

TEST(TrainHead, ToleratesOutliers) {
  const HeadModel truth = testing_head(2);
  Images images = image(truth, 200, 0.5, 4);
  Rng rng(5);
  for (std::size_t f = 0; f < images.faces.size(); f += 3)
    images.faces[f].col(rng.integer(2, 24)) += Eigen::Vector2d(rng.normal(0, 25), 30);
  TrainHeadOptions options = quick();
  options.modes = 2;
  EXPECT_LT(
      aligned_error(train_head(images.faces, markup_of(truth), options).model.mean, truth.mean),
      2.5);
}

// Few faces cannot have more modes than they differ in.
TEST(TrainHead, DropsModesThatFewFacesDoNotHave) {
  const HeadModel truth = testing_head(3);
  const Images images = image(truth, 12, 0.5, 9);
  TrainHeadOptions options;
  options.iterations = 20;
  const TrainedHead trained = train_head(images.faces, markup_of(truth), options);
  EXPECT_GT(trained.model.mode_count(), 0);
  EXPECT_LT(trained.model.mode_count(), options.modes);
  EXPECT_GT(trained.model.deviation.minCoeff(), 0);
}

TEST(TrainHead, RejectsTooFewOrUninformativeFaces) {
  const HeadModel truth = testing_head(0);
  const shape::Markup markup = markup_of(truth);
  const Images images = image(truth, 12, 0, 6);
  const std::vector<Matrix2Xd> few(images.faces.begin(), images.faces.begin() + 9);
  EXPECT_THROW((void)train_head(few, markup), std::invalid_argument);
  // All faces have the same direction, so depth is not observable.
  const std::vector<Matrix2Xd> still(20, image_of(
                                             truth.mean, {Eigen::Matrix3d::Identity(), {0, 0, 1e7}},
                                             [] {
                                               geometry::Camera camera = testing_camera();
                                               camera.fx = camera.fy = 1e7;
                                               return camera;
                                             }(),
                                             0, *std::make_unique<Rng>(1)));
  EXPECT_THROW((void)train_head(still, markup), std::invalid_argument);
  std::vector<Matrix2Xd> mixed = images.faces;
  mixed[3] = mixed[3].leftCols(24).eval();
  EXPECT_THROW((void)train_head(mixed, markup), std::invalid_argument);
  shape::Markup wrong = markup;
  wrong.mirror[0] = 5;
  EXPECT_THROW((void)train_head(images.faces, wrong), std::invalid_argument);
  wrong = markup;
  wrong.outer_eyes = {0, 3};
  EXPECT_THROW((void)train_head(images.faces, wrong), std::invalid_argument);
  TrainHeadOptions options;
  options.modes = -1;
  EXPECT_THROW((void)train_head(images.faces, markup, options), std::invalid_argument);
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW((void)train_head(images.faces, markup, quick(), nullptr, stop.get_token()),
               Interrupted);
}

// Compares with the mean head of ICT-FaceKit, which is not in the training set.
TEST(TrainHeadData, IsCloseToMeasuredHead) {
  TARSIER_LONG_TEST();
  const char* data = std::getenv("TARSIER_DATA");
  const std::filesystem::path folder = data == nullptr ? "" : data;
  if (data == nullptr || !std::filesystem::exists(folder / "faces68/all.txt") ||
      !std::filesystem::exists(folder / "head3d/ict68.txt"))
    GTEST_SKIP() << "needs faces68 and head3d of $TARSIER_DATA";
  std::ifstream file(folder / "head3d/ict68.txt");
  int points = 0;
  int modes = 0;
  file >> points >> modes;
  ASSERT_EQ(points, 68);
  Matrix3Xd measured(3, points);
  for (Eigen::Index i = 0; i < points; ++i) {
    double x = 0, y = 0, z = 0;
    file >> x >> y >> z;  // cm, y up, z towards the camera
    measured.col(i) << 10 * x, -10 * y, -10 * z;
  }
  ASSERT_TRUE(file.good());
  std::vector<int> inner(51);
  std::iota(inner.begin(), inner.end(), 17);

  const auto imported = shape::import_landmarks((folder / "faces68/all.txt").string());
  std::vector<Matrix2Xd> faces;
  for (const auto& sample : imported.set.samples) faces.push_back(sample.points);
  const TrainedHead trained = train_head(faces, *shape::known_markup(68));
  const double all = aligned_error(trained.model.mean, measured);
  const double inside = aligned_error(trained.model.mean, measured, inner);
  RecordProperty("all_mm", std::to_string(all));
  RecordProperty("inner_mm", std::to_string(inside));
  EXPECT_LT(all, 7);
  EXPECT_LT(inside, 5);
  EXPECT_LT(trained.model.mean(2, 30), -20);
  // The result equals the installed model.
  const HeadModel shipped = read_head_model(TARSIER_SOURCE_MODELS "/head.json");
  EXPECT_LT((shipped.mean - trained.model.mean).colwise().norm().maxCoeff(), 0.5);
}

}  // namespace
}  // namespace tarsier::face::head
