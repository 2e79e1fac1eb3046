// SPDX-License-Identifier: MIT
#include "tarsier/face/head/head_pose.h"

#include "tarsier/face/head/testing_head.h"
#include "tarsier/geometry/sim3.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <string>

namespace tarsier::face::head {
namespace {

using Eigen::Matrix2Xd;
using Eigen::Matrix3Xd;
using Eigen::VectorXd;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

VectorXd random_b(const HeadModel& model, Rng& rng) {
  VectorXd b(model.mode_count());
  for (Eigen::Index k = 0; k < b.size(); ++k) b[k] = model.deviation[k] * rng.normal();
  return b;
}

TEST(HeadPose, IsExactForTheMeanHead) {
  const HeadPoseEstimator estimator(testing_head(3));
  const geometry::Camera camera = testing_camera();
  Rng rng(1);
  for (int k = 0; k < 100; ++k) {
    const geometry::Rigid3 truth = random_pose(rng);
    const Matrix2Xd points = image_of(estimator.model().mean, truth, camera, 0, rng);
    const HeadPoseResult result = estimator.pose(points, camera);
    ASSERT_TRUE(result.pose) << result.reason;
    EXPECT_LT(degrees_between(result.pose->camera_from_head, truth), 0.02);
    EXPECT_LT(result.pose->b.norm(), 0.5);
    EXPECT_LT(result.pose->rms_px, 0.05);
    EXPECT_LT((estimator.project(*result.pose, camera) - points).cwiseAbs().maxCoeff(), 0.1);
  }
}

TEST(HeadPose, AngleSignsMatchTheDefinition) {
  const HeadPoseEstimator estimator(testing_head(0));
  const geometry::Camera camera = testing_camera();
  Rng rng(2);
  const auto angles_in_image = [&](const HeadAngles& angles) {
    const Matrix2Xd points =
        image_of(estimator.model().mean, {rotation_of_angles(angles), {0, 0, 700}}, camera, 0, rng);
    return std::pair(estimator.pose(points, camera).pose.value().angles, points);
  };
  // The nose (point 22) moves to image left of the eyes' middle: yaw > 0.
  const auto [left, at_left] = angles_in_image({25, 0, 0});
  EXPECT_LT(at_left(0, 22), (at_left(0, 0) + at_left(0, 1)) / 2 - 5);
  EXPECT_NEAR(left.yaw_deg, 25, 0.1);
  const auto [up, at_up] = angles_in_image({0, 20, 0});
  const auto [straight, at_straight] = angles_in_image({0, 0, 0});
  EXPECT_LT(at_up(1, 22), at_straight(1, 22));
  EXPECT_NEAR(up.pitch_deg, 20, 0.1);
  EXPECT_NEAR(straight.yaw_deg, 0, 0.1);
  // Roll is clockwise in the image: the eye at image right (point 1) goes down.
  const auto [rolled, at_rolled] = angles_in_image({0, 0, 15});
  EXPECT_GT(at_rolled(1, 1), at_rolled(1, 0) + 5);
  EXPECT_NEAR(rolled.roll_deg, 15, 0.1);
}

TEST(HeadPose, ShapeFitAndIdentityReduceTheError) {
  const HeadModel model = testing_head(16);
  const geometry::Camera camera = testing_camera();
  HeadPoseOptions rigid;
  rigid.fit_shape = false;
  const HeadPoseEstimator with_shape(model);
  const HeadPoseEstimator without(model, rigid);
  double of_mean = 0, single = 0, known = 0, shape_error = 0, shape_start = 0;
  for (int person = 0; person < 30; ++person) {
    Rng rng = Rng(3).fork(static_cast<std::uint64_t>(person));
    const VectorXd b = random_b(model, rng);
    const Matrix3Xd shape = shape_of(model, b);
    HeadIdentity identity;
    for (int frame = 0; frame < 30; ++frame) {
      const geometry::Rigid3 truth = random_pose(rng);
      const Matrix2Xd points = image_of(shape, truth, camera, 1, rng);
      const auto error = [&](const HeadPoseResult& result) {
        return degrees_between(result.pose.value().camera_from_head, truth);
      };
      const double with_identity = error(with_shape.pose(points, camera, identity));
      if (frame < 10) continue;
      of_mean += error(without.pose(points, camera)) / 600;
      single += error(with_shape.pose(points, camera)) / 600;
      known += with_identity / 600;
    }
    EXPECT_EQ(identity.frames, 30);
    shape_error += (identity.shape(model) - b).norm();
    shape_start += b.norm();
  }
  EXPECT_LT(single, 0.5 * of_mean);
  EXPECT_LT(known, 0.9 * single);
  EXPECT_LT(shape_error, 0.15 * shape_start);
}

TEST(HeadIdentityState, StartsAtZeroAndForgetsSlowly) {
  const HeadModel model = testing_head(4);
  const HeadPoseEstimator estimator(model);
  const geometry::Camera camera = testing_camera();
  HeadIdentity identity;
  EXPECT_EQ(identity.shape(model), VectorXd::Zero(4));
  Rng rng(4);
  const auto show = [&](const VectorXd& b, int frames) {
    for (int k = 0; k < frames; ++k)
      (void)estimator.pose(image_of(shape_of(model, b), random_pose(rng), camera, 0.5, rng), camera,
                           identity);
  };
  const VectorXd first = random_b(model, rng);
  const VectorXd second = random_b(model, rng);
  show(first, 30);
  EXPECT_LT((identity.shape(model) - first).norm(), 0.3 * first.norm());
  // After many frames of another person, the identity is nearer to that person.
  show(second, 600);
  EXPECT_LT((identity.shape(model) - second).norm(), (identity.shape(model) - first).norm());
  // A frame without a pose does not change the identity.
  const int before = identity.frames;
  EXPECT_FALSE(estimator.pose(Matrix2Xd::Constant(2, 25, kNan), camera, identity).pose);
  EXPECT_EQ(identity.frames, before);
  HeadIdentity other;
  other.frames = 1;
  other.vector = VectorXd::Zero(9);
  other.information = Eigen::MatrixXd::Zero(9, 9);
  EXPECT_THROW((void)estimator.pose(Matrix2Xd::Zero(2, 25), camera, other), std::invalid_argument);
}

TEST(HeadPose, ToleratesMissingPointsAndOutliers) {
  const HeadPoseEstimator estimator(testing_head(3));
  const geometry::Camera camera = testing_camera();
  Rng rng(5);
  double worst = 0;
  for (int k = 0; k < 50; ++k) {
    const geometry::Rigid3 truth = random_pose(rng);
    Matrix2Xd points = image_of(estimator.model().mean, truth, camera, 0, rng);
    for (int hole = 0; hole < 8; ++hole) points.col(rng.integer(0, 24)).setConstant(kNan);
    points.col(rng.integer(0, 24)) += Eigen::Vector2d(40, -30);
    const HeadPoseResult result = estimator.pose(points, camera);
    ASSERT_TRUE(result.pose) << result.reason;
    worst = std::max(worst, degrees_between(result.pose->camera_from_head, truth));
  }
  EXPECT_LT(worst, 3);
}

TEST(HeadPose, UncertainPointsGetLessWeight) {
  const HeadPoseEstimator estimator(testing_head(8));
  const geometry::Camera camera = testing_camera();
  double unweighted = 0;
  double weighted = 0;
  for (int k = 0; k < 40; ++k) {
    Rng rng = Rng(11).fork(static_cast<std::uint64_t>(k));
    const geometry::Rigid3 truth = random_pose(rng);
    Matrix2Xd points = image_of(shape_of(estimator.model(), random_b(estimator.model(), rng)),
                                truth, camera, 1, rng);
    // A hand hides every third point. All hidden points are moved in the same way, by less than an
    // outlier.
    VectorXd sigma_px = VectorXd::Constant(points.cols(), 1);
    const Eigen::Vector2d displacement(rng.normal(0, 6), 6);
    for (Eigen::Index i = 0; i < points.cols(); i += 3) {
      points.col(i) += displacement;
      sigma_px[i] = 9;
    }
    const auto error = [&](const HeadPoseResult& result) {
      return degrees_between(result.pose.value().camera_from_head, truth);
    };
    unweighted += error(estimator.pose(points, camera)) / 40;
    weighted += error(estimator.pose(points, camera, sigma_px)) / 40;
    HeadIdentity identity;
    EXPECT_NEAR(error(estimator.pose(points, camera, identity, sigma_px)),
                error(estimator.pose(points, camera, sigma_px)), 1e-9);
  }
  EXPECT_LT(weighted, 0.7 * unweighted) << unweighted;
  const Matrix2Xd points = Matrix2Xd::Random(2, estimator.model().points()) * 100 +
                           Matrix2Xd::Constant(2, estimator.model().points(), 200);
  EXPECT_THROW((void)estimator.pose(points, camera, VectorXd::Ones(3)), std::invalid_argument);
  EXPECT_THROW((void)estimator.pose(points, camera, VectorXd::Zero(points.cols())),
               std::invalid_argument);
}

TEST(HeadPose, RefusesWithAReason) {
  const HeadPoseEstimator estimator(testing_head(2));
  const geometry::Camera camera = testing_camera();
  Rng rng(6);
  const Matrix2Xd points = image_of(estimator.model().mean, random_pose(rng), camera, 0, rng);
  const auto reason_of = [&](const Matrix2Xd& bad) {
    const HeadPoseResult result = estimator.pose(bad, camera);
    EXPECT_FALSE(result.pose);
    return result.reason;
  };
  EXPECT_NE(reason_of(points.leftCols(20)).find("as many"), std::string::npos);
  Matrix2Xd holes = points;
  holes.rightCols(20).setConstant(kNan);
  EXPECT_NE(reason_of(holes).find("fewer than 6"), std::string::npos);
  EXPECT_FALSE(reason_of(Matrix2Xd::Constant(2, 25, 100)).empty());
  for (int k = 0; k < 100; ++k) {
    Matrix2Xd random_points(2, 25);
    for (Eigen::Index i = 0; i < random_points.size(); ++i)
      random_points.data()[i] = rng.uniform(0, 640);
    const HeadPoseResult result = estimator.pose(random_points, camera);
    if (result.pose) {
      EXPECT_TRUE(std::isfinite(result.pose->rms_px));
      EXPECT_TRUE(std::isfinite(result.pose->angles.yaw_deg));
    } else {
      EXPECT_FALSE(result.reason.empty());
    }
  }
  HeadPoseOptions options;
  options.memory = 0;
  EXPECT_THROW(HeadPoseEstimator(testing_head(2), options), std::invalid_argument);
  options = {};
  options.outline = {25};
  EXPECT_THROW(HeadPoseEstimator(testing_head(2), options), std::invalid_argument);
}

// In a turned head, the far side of the outline is the edge of the cheek. So these points get a low
// weight.
TEST(HeadPose, DownweightsFarOutlineOfTurnedHead) {
  const HeadModel model = testing_head(0);
  HeadPoseOptions options;
  options.outline = {16, 17, 18, 19, 20, 21};  // the sides; even ones at image left
  const HeadPoseEstimator estimator(model, options);
  options.outline_yaw_deg = 1000;
  const HeadPoseEstimator without_outline_weight(model, options);
  const geometry::Camera camera = testing_camera();
  Rng rng(7);
  // yaw > 0: the head turns to image left, and that side is the far one.
  const geometry::Rigid3 truth{rotation_of_angles({35, 0, 0}), {0, 0, 600}};
  Matrix2Xd points = image_of(model.mean, truth, camera, 0, rng);
  for (const int i : {16, 18, 20}) points(0, i) -= 8;
  const double error =
      degrees_between(estimator.pose(points, camera).pose.value().camera_from_head, truth);
  const double unweighted = degrees_between(
      without_outline_weight.pose(points, camera).pose.value().camera_from_head, truth);
  EXPECT_LT(error, 0.1);
  EXPECT_GT(unweighted, 5 * error);
}

// Shares of the errors within one and two of the reported deviations.
struct Covered {
  int count = 0;
  Eigen::Array3d one = Eigen::Array3d::Zero();  // yaw, pitch, roll
  Eigen::Array3d two = Eigen::Array3d::Zero();

  void add(const HeadPose& found, const geometry::Rigid3& truth) {
    const HeadAngles angles = angles_of_rotation(truth.rotation);
    const Eigen::Array3d error(found.angles.yaw_deg - angles.yaw_deg,
                               found.angles.pitch_deg - angles.pitch_deg,
                               found.angles.roll_deg - angles.roll_deg);
    const Eigen::Array3d sigma(found.yaw_sigma_deg, found.pitch_sigma_deg, found.roll_sigma_deg);
    ++count;
    one += (error.abs() <= sigma).cast<double>();
    two += (error.abs() <= 2 * sigma).cast<double>();
  }
  // 1500 cases: 68.3 and 95.4 %, with standard errors of 1.2 and 0.5 %.
  void expect_right(const char* what, double off_one = 0.04, double off_two = 0.02) const {
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(one[axis] / count, 0.683, off_one) << what << ", axis " << axis;
      EXPECT_NEAR(two[axis] / count, 0.954, off_two) << what << ", axis " << axis;
    }
  }
};

constexpr int kCoverageCases = 1500;

// A random person of the model: its modes and each point's own deviation.
Matrix3Xd random_shape(const HeadModel& model, Rng& rng) {
  Matrix3Xd shape = shape_of(model, random_b(model, rng));
  for (Eigen::Index i = 0; i < shape.cols(); ++i)
    for (Eigen::Index k = 0; k < 3; ++k) shape(k, i) += model.noise[i] * rng.normal();
  return shape;
}

TEST(HeadPoseSigma, CoversErrorsForKnownNoise) {
  const HeadModel model = testing_head(8);
  const HeadPoseEstimator estimator(model);
  HeadPoseOptions rigid;
  rigid.fit_shape = false;
  const HeadPoseEstimator of_mean_head(model, rigid);
  const geometry::Camera camera = testing_camera();
  Covered plain;
  Covered weighted;
  Covered scaled;
  Covered mean_head;
  for (int k = 0; k < kCoverageCases; ++k) {
    Rng rng = Rng(21).fork(static_cast<std::uint64_t>(k));
    const Matrix3Xd shape = random_shape(model, rng);
    const geometry::Rigid3 truth = random_pose(rng);
    const Matrix2Xd exact = image_of(shape, truth, camera, 0, rng);
    const auto with_noise = [&](const VectorXd& deviation_px) {
      Matrix2Xd points = exact;
      for (Eigen::Index i = 0; i < points.cols(); ++i)
        for (Eigen::Index axis = 0; axis < 2; ++axis)
          points(axis, i) += deviation_px[i] * rng.normal();
      return points;
    };
    const VectorXd ones = VectorXd::Ones(exact.cols());
    plain.add(estimator.pose(with_noise(ones), camera).pose.value(), truth);
    mean_head.add(of_mean_head.pose(with_noise(ones), camera).pose.value(), truth);
    // Noise above that of the options increases the residuals.
    scaled.add(estimator.pose(with_noise(3 * ones), camera).pose.value(), truth);
    VectorXd sigma_px(exact.cols());  // 68 % of the distances
    for (double& value : sigma_px) value = rng.uniform(1.6, 8);
    weighted.add(estimator.pose(with_noise(sigma_px / 1.51), camera, sigma_px).pose.value(), truth);
  }
  plain.expect_right("1 px, which is the options' noise");
  // The robust weights assume residuals other than those of the shape. And fewer than 50 residuals
  // estimate their scale.
  mean_head.expect_right("without shape", 0.09, 0.05);
  scaled.expect_right("3 px, and no deviation given", 0.08, 0.05);
  weighted.expect_right("a deviation for each point");
}

TEST(HeadPoseSigma, GrowsWithDistanceNoiseAndMissingPoints) {
  const HeadPoseEstimator estimator(testing_head(8));
  const geometry::Camera camera = testing_camera();
  for (int k = 0; k < 30; ++k) {
    Rng rng = Rng(22).fork(static_cast<std::uint64_t>(k));
    geometry::Rigid3 near = random_pose(rng);
    near.translation *= 500 / near.translation[2];
    geometry::Rigid3 far = near;
    far.translation *= 4;
    const Matrix3Xd shape = random_shape(estimator.model(), rng);
    const auto sigma_of = [&](const Matrix2Xd& points, const VectorXd& sigma_px = {}) {
      const HeadPose pose = estimator.pose(points, camera, sigma_px).pose.value();
      return Eigen::Array3d(pose.yaw_sigma_deg, pose.pitch_sigma_deg, pose.roll_sigma_deg);
    };
    const Matrix2Xd points = image_of(shape, near, camera, 0.2, rng);
    const Eigen::Array3d whole = sigma_of(points);
    EXPECT_GT(whole.minCoeff(), 0);
    EXPECT_LT(whole.maxCoeff(), 10);
    // The even points of the pairs are on one side.
    Matrix2Xd half = points;
    for (int i = 0; i < 22; i += 2) half.col(i).setConstant(kNan);
    EXPECT_TRUE((sigma_of(half) > whole).all()) << k;
    // Points behind a hand are fitted, but with large errors.
    const VectorXd sure = VectorXd::Constant(points.cols(), 1.5);
    VectorXd covered = sure;
    for (int i = 0; i < 22; i += 2) covered[i] = 15;
    EXPECT_TRUE((sigma_of(points, covered) > sigma_of(points, sure)).all()) << k;
    EXPECT_TRUE((sigma_of(image_of(shape, far, camera, 0.2, rng)) > 1.5 * whole).all()) << k;
  }
}

TEST(HeadPoseSigma, DoesNotShrinkWithVideoLength) {
  const HeadPoseEstimator estimator(testing_head(8));
  const geometry::Camera camera = testing_camera();
  Rng rng(23);
  const geometry::Rigid3 truth = random_pose(rng);
  const Matrix2Xd points = image_of(estimator.model().mean, truth, camera, 0.5, rng);
  HeadIdentity identity;
  const double first = estimator.pose(points, camera, identity).pose.value().yaw_sigma_deg;
  for (int k = 0; k < 50; ++k) (void)estimator.pose(points, camera, identity);
  EXPECT_NEAR(estimator.pose(points, camera, identity).pose.value().yaw_sigma_deg, first,
              0.1 * first);
}

// Heads of ICT-FaceKit's 100 identity modes, which the installed model was not trained on. Measures
// how much the identity over frames gains.
TEST(HeadPoseData, IdentityReducesErrorForUnseenPeople) {
  const char* data = std::getenv("TARSIER_DATA");
  std::ifstream file((data == nullptr ? std::string() : std::string(data)) + "/head3d/ict68.txt");
  if (!file.good()) GTEST_SKIP() << "needs head3d of $TARSIER_DATA";
  int points = 0;
  int modes = 0;
  file >> points >> modes;
  ASSERT_EQ(points, 68);
  ASSERT_EQ(modes, 100);
  Eigen::MatrixXd columns(3 * points, 1 + modes);
  for (Eigen::Index k = 0; k <= modes; ++k) {
    for (Eigen::Index i = 0; i < points; ++i) {
      double x = 0, y = 0, z = 0;
      file >> x >> y >> z;  // cm, y up, z towards the camera
      columns.block<3, 1>(3 * i, k) << 10 * x, -10 * y, -10 * z;
    }
  }
  ASSERT_TRUE(file.good());
  const HeadModel model = read_head_model(TARSIER_SOURCE_MODELS "/head.json");
  const Matrix3Xd mean = Eigen::Map<const Matrix3Xd>(columns.data(), 3, points);
  const Eigen::Matrix3d ict_from_model = geometry::similarity_between(model.mean, mean)->rotation;

  HeadPoseOptions rigid;
  rigid.fit_shape = false;
  const HeadPoseEstimator without(model, rigid);
  const HeadPoseEstimator estimator(model);
  const geometry::Camera camera = testing_camera();
  double of_mean = 0, single = 0, known = 0;
  const int people = 60;
  for (int person = 0; person < people; ++person) {
    Rng rng = Rng(7).fork(static_cast<std::uint64_t>(person));
    VectorXd weights(1 + modes);
    weights[0] = 1;
    for (Eigen::Index k = 1; k <= modes; ++k) weights[k] = rng.normal();
    const VectorXd flat = columns * weights;
    const Matrix3Xd shape = Eigen::Map<const Matrix3Xd>(flat.data(), 3, points);
    HeadIdentity identity;
    for (int frame = 0; frame < 35; ++frame) {
      const geometry::Rigid3 truth = random_pose(rng);
      const Matrix2Xd pixels = image_of(shape, truth, camera, 1, rng);
      const auto error = [&](const HeadPoseResult& result) {
        geometry::Rigid3 found = result.pose.value().camera_from_head;
        found.rotation = found.rotation * ict_from_model.transpose();
        return degrees_between(found, truth) / (5 * people);
      };
      const double with_identity = error(estimator.pose(pixels, camera, identity));
      if (frame < 30) continue;
      of_mean += error(without.pose(pixels, camera));
      single += error(estimator.pose(pixels, camera));
      known += with_identity;
    }
  }
  RecordProperty("mean_head_deg", std::to_string(of_mean));
  RecordProperty("single_frame_deg", std::to_string(single));
  RecordProperty("after_30_frames_deg", std::to_string(known));
  EXPECT_LT(single, of_mean);
  EXPECT_LT(known, 0.9 * single);
  EXPECT_LT(known, 2.7);
}

TEST(GuessCamera, UsesImageCenterAndDefaultFocalLength) {
  const geometry::Camera camera = guess_camera({640, 480});
  camera.check();
  EXPECT_NEAR(camera.fx, 832, 1e-9);
  EXPECT_NEAR(camera.cx, 319.5, 1e-9);
  EXPECT_NEAR(guess_camera({480, 640}).fy, 832, 1e-9);
  EXPECT_THROW((void)guess_camera({0, 480}), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::head
