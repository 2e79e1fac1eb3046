// SPDX-License-Identifier: MIT
#include "tarsier/face/head/posit.h"

#include "tarsier/face/head/draw_pose.h"
#include "tarsier/face/head/posit_study.h"
#include "tarsier/face/head/testing_head.h"

#include <Eigen/LU>
#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

#include <cmath>
#include <cstdlib>
#include <limits>
#include <numbers>
#include <string>

namespace tarsier::face::head {
namespace {

using Eigen::Matrix2Xd;
using Eigen::Matrix3Xd;
using Eigen::VectorXd;

Matrix2Xd normalized_image(const Matrix3Xd& shape, const geometry::Rigid3& pose) {
  Matrix2Xd image(2, shape.cols());
  for (Eigen::Index i = 0; i < shape.cols(); ++i) {
    const Eigen::Vector3d x = pose * shape.col(i);
    image.col(i) << x[0] / x[2], x[1] / x[2];
  }
  return image;
}

PositOptions options_of(PositMethod method, int refine_steps = 0) {
  PositOptions options;
  options.method = method;
  options.refine_steps = refine_steps;
  options.max_iterations = 200;
  options.tolerance = 1e-10;
  return options;
}

TEST(Posit, IsExactWithoutNoise) {
  Rng rng(1);
  PositWorkspace workspace;
  const Matrix3Xd shape = testing_head(0).mean;
  for (const int reference : {0, 22}) {
    const PositModel model(shape, {}, reference);
    for (int k = 0; k < 200; ++k) {
      const geometry::Rigid3 truth = random_pose(rng);
      const Matrix2Xd image = normalized_image(shape, truth);
      for (const PositOptions& options :
           {options_of(PositMethod::kClassic), options_of(PositMethod::kHomogeneous),
            options_of(PositMethod::kHomogeneous, 3)}) {
        const PositResult result = posit(model, image, options, workspace);
        ASSERT_TRUE(result.pose) << result.reason;
        EXPECT_TRUE(result.pose->converged);
        EXPECT_LT(degrees_between(result.pose->camera_from_object, truth), 1e-5);
        EXPECT_LT((result.pose->camera_from_object.translation - truth.translation).norm(), 1e-4);
        EXPECT_LT(result.pose->rms, 1e-8);
      }
    }
  }
}

TEST(Posit, UndistortsPixels) {
  Rng rng(2);
  const Matrix3Xd shape = testing_head(0).mean;
  const PositModel model(shape);
  geometry::Camera camera = testing_camera();
  camera.fy = 780;
  camera.distortion = {-0.2, 0.05, 0.001, -0.002, 0};
  PositWorkspace workspace;
  const geometry::Rigid3 truth = random_pose(rng);
  const Matrix2Xd pixels = image_of(shape, truth, camera, 0, rng);
  const PositResult result =
      posit(model, pixels, camera, options_of(PositMethod::kHomogeneous), workspace);
  ASSERT_TRUE(result.pose) << result.reason;
  EXPECT_LT(degrees_between(result.pose->camera_from_object, truth), 1e-5);
}

TEST(Posit, RefinementMinimisesReprojectionError) {
  Rng rng(3);
  const Matrix3Xd shape = testing_head(0).mean;
  const PositModel model(shape);
  PositWorkspace workspace;
  for (int k = 0; k < 50; ++k) {
    const geometry::Rigid3 truth = random_pose(rng);
    Matrix2Xd image = normalized_image(shape, truth);
    for (Eigen::Index i = 0; i < image.size(); ++i) image.data()[i] += 0.005 * rng.normal();
    const auto rough = posit(model, image, options_of(PositMethod::kHomogeneous), workspace).pose;
    const auto fine =
        posit(model, image, options_of(PositMethod::kHomogeneous, 20), workspace).pose;
    ASSERT_TRUE(rough && fine);
    EXPECT_LE(fine->rms, rough->rms);
    // No neighbouring pose is better.
    for (int axis = 0; axis < 6; ++axis) {
      for (const double sign : {-1.0, 1.0}) {
        geometry::Rigid3 moved = fine->camera_from_object;
        if (axis < 3) {
          moved.translation[axis] += sign * 0.3;
        } else {
          Eigen::Vector4d turn(1, 0, 0, 0);
          turn[axis - 2] = sign * 5e-4;
          moved.rotation = geometry::rotation_of(turn) * moved.rotation;
        }
        const double rms = std::sqrt((normalized_image(shape, moved) - image).squaredNorm() /
                                     static_cast<double>(shape.cols()));
        EXPECT_GT(rms, fine->rms);
      }
    }
  }
}

TEST(Posit, IgnoresPointsOfZeroWeight) {
  Rng rng(4);
  const Matrix3Xd shape = testing_head(0).mean;
  VectorXd weights = VectorXd::Ones(shape.cols());
  weights[5] = 0;
  const PositModel model(shape, weights);
  const geometry::Rigid3 truth = random_pose(rng);
  Matrix2Xd image = normalized_image(shape, truth);
  image.col(5) << 3, -2;
  PositWorkspace workspace;
  const PositResult result =
      posit(model, image, options_of(PositMethod::kHomogeneous, 3), workspace);
  ASSERT_TRUE(result.pose);
  EXPECT_LT(degrees_between(result.pose->camera_from_object, truth), 1e-5);
}

// The cube of the demonstration: side 10, four corners, px from the centre of the image.
TEST(Posit, SolvesTheCube) {
  Matrix3Xd corners(3, 4);
  corners << 0, 0, 10, 0,  //
      0, 0, 0, 10,         //
      0, 10, 0, 0;
  Matrix2Xd pixels(2, 4);
  pixels << -48, -287, 132, -52, -224, -174, -153, 149;
  geometry::Camera camera;
  camera.width = 800;
  camera.height = 600;
  camera.fx = camera.fy = 1000;
  camera.cx = 399.5;
  camera.cy = 299.5;
  const Matrix2Xd placed = pixels.colwise() + Eigen::Vector2d(camera.cx, camera.cy);
  const PositModel model(corners);
  PositWorkspace workspace;
  for (const PositMethod method : {PositMethod::kClassic, PositMethod::kHomogeneous}) {
    const PositResult result = posit(model, placed, camera, options_of(method), workspace);
    ASSERT_TRUE(result.pose) << result.reason;
    const geometry::Rigid3& pose = result.pose->camera_from_object;
    EXPECT_LT((pose.rotation.transpose() * pose.rotation - Eigen::Matrix3d::Identity()).norm(),
              1e-9);
    EXPECT_NEAR(pose.rotation.determinant(), 1, 1e-9);
    EXPECT_LT(result.pose->rms, 1.5);  // coordinates are whole px
    EXPECT_NEAR(pose.translation[2], 27, 0.5);
    EXPECT_GT(pose.rotation(0, 0), 0.5);
    EXPECT_GT(pose.rotation(1, 1), 0.5);
    EXPECT_LT(pose.rotation(0, 2), -0.5);
    if (method == PositMethod::kHomogeneous) {
      cv::Mat projected(camera.height, camera.width, CV_8UC3, cv::Scalar(50, 45, 40));
      draw_box(projected, camera, pose, {0, 0, 0}, {10, 10, 10});
      draw_axes(projected, camera, pose, {13, 13, 13});
      if (const char* folder = std::getenv("TARSIER_TEST_IMAGES"))
        cv::imwrite(std::string(folder) + "/cube.png", projected);
      // The box's corners lie on the given points.
      const auto corner = camera.project(pose * Eigen::Vector3d(0, 10, 0));
      ASSERT_TRUE(corner);
      EXPECT_LT(std::hypot(corner->x - placed(0, 3), corner->y - placed(1, 3)), 4);
    }
  }
}

TEST(Posit, GivesAReasonIfThereIsNoPose) {
  const Matrix3Xd shape = testing_head(0).mean;
  const Matrix2Xd image = normalized_image(shape, {Eigen::Matrix3d::Identity(), {0, 0, 600}});
  PositWorkspace workspace;
  const PositOptions options;
  const auto reason_of = [&](const Matrix3Xd& points, const Matrix2Xd& projected) {
    const PositResult result = posit(PositModel(points), projected, options, workspace);
    EXPECT_FALSE(result.pose);
    return std::string(result.reason);
  };
  EXPECT_NE(reason_of(shape.leftCols(3), image.leftCols(3)).find("4 points"), std::string::npos);
  EXPECT_NE(reason_of(Matrix3Xd(3, 0), Matrix2Xd(2, 0)).find("4 points"), std::string::npos);
  Matrix3Xd flat = shape;
  flat.row(2).setConstant(7);
  EXPECT_NE(reason_of(flat, image).find("coplanar"), std::string::npos);
  flat.row(1) = 2 * flat.row(0);
  EXPECT_NE(reason_of(flat, image).find("collinear"), std::string::npos);
  EXPECT_NE(reason_of(Matrix3Xd::Constant(3, 6, 2), image.leftCols(6)).find("extent"),
            std::string::npos);
  Matrix3Xd broken = shape;
  broken(1, 4) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(reason_of(broken, image).find("not finite"), std::string::npos);
  EXPECT_NE(reason_of(shape, image.leftCols(9)).find("as many"), std::string::npos);
  Matrix2Xd hole = image;
  hole(0, 2) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(reason_of(shape, hole).find("not finite"), std::string::npos);
  EXPECT_NE(reason_of(shape, Matrix2Xd::Constant(2, shape.cols(), 0.1)).find("coincide"),
            std::string::npos);
  EXPECT_THROW(PositModel(shape, VectorXd::Constant(25, -1)), std::invalid_argument);
  EXPECT_THROW(PositModel(shape, {}, 25), std::invalid_argument);
}

TEST(Posit, NeverReturnsPoseBehindTheCameraOrNan) {
  Rng rng(5);
  PositWorkspace workspace;
  const PositModel model(testing_head(0).mean);
  for (int k = 0; k < 300; ++k) {
    Matrix2Xd image(2, 25);
    const double spread = std::exp(rng.uniform(-5, 5));
    for (Eigen::Index i = 0; i < image.size(); ++i) image.data()[i] = spread * rng.normal();
    for (const PositMethod method : {PositMethod::kClassic, PositMethod::kHomogeneous}) {
      PositOptions options = options_of(method, 3);
      const PositResult result = posit(model, image, options, workspace);
      if (!result.pose) {
        EXPECT_STRNE(result.reason, "");
        continue;
      }
      const geometry::Rigid3& pose = result.pose->camera_from_object;
      EXPECT_TRUE(std::isfinite(result.pose->rms));
      EXPECT_NEAR(pose.rotation.determinant(), 1, 1e-6);
      for (Eigen::Index i = 0; i < 25; ++i) {
        const Eigen::Vector3d p = testing_head(0).mean.col(i);
        EXPECT_GT((pose * Eigen::Vector3d(p[0], p[1], p[2]))[2], 0);
      }
    }
  }
}

TEST(PositSigma, CoversTheErrorsOfNoisyPoints) {
  constexpr int kCases = 1500;
  geometry::Camera camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 800;
  camera.cx = 320;
  camera.cy = 240;
  PositOptions options;
  options.refine_steps = 20;
  PositWorkspace workspace;
  Eigen::Array<double, 6, 1> within = Eigen::Array<double, 6, 1>::Zero();
  for (int k = 0; k < kCases; ++k) {
    Rng rng = Rng(31).fork(static_cast<std::uint64_t>(k));
    Eigen::Matrix3Xd object(3, 30);
    for (double& value : object.reshaped()) value = rng.uniform(-60, 60);
    Eigen::Vector3d turn;
    for (double& value : turn) value = rng.normal();
    const geometry::Rigid3 truth{geometry::rotation_by(turn), {20, -30, 700}};
    Eigen::Matrix2Xd image(2, object.cols());
    for (Eigen::Index i = 0; i < object.cols(); ++i) {
      const auto pixel = camera.project(truth * Eigen::Vector3d(object.col(i)));
      const double noise = 0.8 * rng.normal();
      image.col(i) << pixel->x + noise, pixel->y + 0.8 * rng.normal();
    }
    const PositResult found = posit(PositModel(object), image, camera, options, workspace);
    ASSERT_TRUE(found.pose) << found.reason;
    const geometry::Rigid3& pose = found.pose->camera_from_object;
    const auto sigma = posit_sigma(object, image, camera, pose);
    ASSERT_TRUE(sigma);
    const Eigen::Array3d off =
        geometry::rotation_vector(truth.rotation * pose.rotation.transpose()).array().abs();
    within.head<3>() +=
        (off * (180 / std::numbers::pi) <= sigma->rotation_deg.array()).cast<double>();
    within.tail<3>() +=
        ((truth.translation - pose.translation).array().abs() <= sigma->translation.array())
            .cast<double>();
  }
  for (int axis = 0; axis < 6; ++axis) EXPECT_NEAR(within[axis] / kCases, 0.683, 0.04) << axis;
  EXPECT_FALSE(posit_sigma(Eigen::Matrix3Xd::Random(3, 3), Eigen::Matrix2Xd::Random(2, 3), camera,
                           {Eigen::Matrix3d::Identity(), {0, 0, 9}}));
}

TEST(PositPlanar, FindsBothPosesOfAPlane) {
  Rng rng(6);
  Matrix3Xd plane(3, 8);
  for (Eigen::Index i = 0; i < 8; ++i)
    plane.col(i) << rng.uniform(-50, 50), rng.uniform(-50, 50), 20;
  const PositModel model(plane);
  EXPECT_STREQ(model.planar_defect(), "");
  PositWorkspace workspace;
  int both = 0;
  for (int k = 0; k < 200; ++k) {
    const geometry::Rigid3 truth = random_pose(rng);
    const Matrix2Xd image = normalized_image(plane, truth);
    const PlanarPositResult found = posit_planar(model, image, {}, workspace);
    ASSERT_TRUE(found.poses[0]) << found.reason;
    EXPECT_LT(degrees_between(found.poses[0]->camera_from_object, truth), 1e-3) << k;
    if (!found.poses[1]) continue;
    ++both;
    EXPECT_GE(found.poses[1]->rms, found.poses[0]->rms);
    EXPECT_LT(found.poses[1]->rms, 0.02);  // almost as good: the two poses are ambiguous
    EXPECT_GT(degrees_between(found.poses[1]->camera_from_object, truth), 0.05);
  }
  EXPECT_GT(both, 100);
}

TEST(PositPlanar, RecoversPoseOfNearlyFlatObject) {
  Rng rng(7);
  Matrix3Xd thin(3, 12);
  for (Eigen::Index i = 0; i < 12; ++i)
    thin.col(i) << rng.uniform(-50, 50), rng.uniform(-50, 50), rng.uniform(-0.5, 0.5);
  const PositModel model(thin);
  PositWorkspace workspace;
  for (int k = 0; k < 100; ++k) {
    const geometry::Rigid3 truth = random_pose(rng);
    const PlanarPositResult found =
        posit_planar(model, normalized_image(thin, truth), {}, workspace);
    ASSERT_TRUE(found.poses[0]) << found.reason;
    EXPECT_LT(degrees_between(found.poses[0]->camera_from_object, truth), 1e-2) << k;
  }
}

TEST(PositPlanar, RejectsCollinearPoints) {
  Matrix3Xd line(3, 5);
  for (Eigen::Index i = 0; i < 5; ++i) line.col(i) << static_cast<double>(i), 0, 0;
  PositWorkspace workspace;
  const PlanarPositResult found =
      posit_planar(PositModel(line), Matrix2Xd::Random(2, 5), {}, workspace);
  EXPECT_FALSE(found.poses[0]);
  EXPECT_NE(std::string(found.reason).find("collinear"), std::string::npos);
}

// The study of `tarsier bench posit`, on the installed head.
TEST(PositStudy, IsNearlyAsAccurateAsSqpnp) {
  const HeadModel model = read_head_model(TARSIER_SOURCE_MODELS "/head.json");
  PositStudyOptions options;
  options.poses = 500;
  const auto rows = run_posit_study(model.mean, options);
  ASSERT_EQ(rows.size(), 16U);
  // The same seed gives the same result.
  options.noise_px = {2};
  const auto again = run_posit_study(model.mean, options);
  options.noise_px = {0, 0.5, 1, 2};
  EXPECT_EQ(again[2].rotation_deg, rows[14].rotation_deg);
  const char* order[] = {"posit-classic", "posit-homogeneous", "posit-homogeneous-lm", "sqpnp"};
  for (std::size_t r = 0; r < rows.size(); ++r) {
    EXPECT_EQ(rows[r].method, order[r % 4]);
    EXPECT_EQ(rows[r].noise_px, options.noise_px[r / 4]);
    EXPECT_EQ(rows[r].failures, 0);
    const PositStudyRow& sqpnp = rows[r / 4 * 4 + 3];
    if (r % 4 == 3) continue;
    if (rows[r].noise_px == 0) {
      EXPECT_LT(rows[r].rotation_deg, 0.005) << rows[r].method;
    } else if (r % 4 == 0) {
      EXPECT_LT(rows[r].rotation_deg, 5 * sqpnp.rotation_deg);
    } else {
      EXPECT_LT(rows[r].rotation_deg, 1.1 * sqpnp.rotation_deg) << rows[r].method;
      EXPECT_LT(rows[r].translation_mm, 1.1 * sqpnp.translation_mm) << rows[r].method;
    }
  }
}

}  // namespace
}  // namespace tarsier::face::head
