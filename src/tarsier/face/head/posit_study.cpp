// SPDX-License-Identifier: MIT
#include "tarsier/face/head/posit_study.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/head/angles.h"
#include "tarsier/face/head/posit.h"
#include "tarsier/geometry/opencv_types.h"

#include <opencv2/calib3d.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <numbers>

namespace tarsier::face::head {
namespace {

constexpr double kFocal = 800;

struct Scene {
  geometry::Rigid3 truth;
  Eigen::Matrix2Xd pixels;
};

Scene random_scene(const Eigen::Matrix3Xd& points, double noise_px, Rng rng) {
  Scene scene;
  scene.truth.rotation =
      rotation_of_angles({rng.uniform(-45, 45), rng.uniform(-30, 30), rng.uniform(-20, 20)});
  const double distance = rng.uniform(450, 900);
  // The centre of the head within an image of 640 x 480.
  scene.truth.translation = {distance * rng.uniform(-160, 160) / kFocal,
                             distance * rng.uniform(-80, 80) / kFocal, distance};
  scene.pixels.resize(2, points.cols());
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const Eigen::Vector3d x = scene.truth * points.col(i);
    scene.pixels(0, i) = 320 + kFocal * x[0] / x[2] + noise_px * rng.normal();
    scene.pixels(1, i) = 240 + kFocal * x[1] / x[2] + noise_px * rng.normal();
  }
  return scene;
}

}  // namespace

std::vector<PositStudyRow> run_posit_study(const Eigen::Matrix3Xd& points,
                                           const PositStudyOptions& options,
                                           const std::stop_token& stop) {
  options.check();
  const Eigen::Vector3d middle = points.rowwise().mean();
  const Eigen::Matrix3Xd centred = points.colwise() - middle;
  const PositModel model(centred, {}, options.reference);
  TARSIER_REQUIRE(*model.defect() == 0, "{}", model.defect());
  geometry::Camera camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = kFocal;
  camera.cx = 320;
  camera.cy = 240;
  std::vector<cv::Point3d> object;
  for (Eigen::Index i = 0; i < centred.cols(); ++i)
    object.emplace_back(centred(0, i), centred(1, i), centred(2, i));
  const cv::Mat matrix(camera.matrix());
  constexpr std::array<const char*, 4> kMethods = {"posit-classic", "posit-homogeneous",
                                                   "posit-homogeneous-lm", "sqpnp"};
  std::vector<PositStudyRow> rows;
  PositWorkspace workspace;
  for (const double noise : options.noise_px) {
    for (std::size_t method = 0; method < kMethods.size(); ++method) {
      PositOptions with;
      with.method = method == 0 ? PositMethod::kClassic : PositMethod::kHomogeneous;
      with.refine_steps = method == 2 ? 3 : 0;
      // Before a refinement, a rough solution is enough.
      if (method == 2) with.tolerance = 1e-3;
      PositStudyRow row;
      row.method = kMethods[method];
      row.noise_px = noise;
      std::vector<double> times;
      std::vector<cv::Point2d> image(object.size());
      for (int pose = 0; pose < options.poses; ++pose) {
        throw_if_stopped(stop);
        const Scene scene =
            random_scene(centred, noise, Rng(options.seed).fork(static_cast<std::uint64_t>(pose)));
        geometry::Rigid3 found;
        bool is_found = false;
        const auto start = std::chrono::steady_clock::now();
        if (method < 3) {
          const PositResult result = posit(model, scene.pixels, camera, with, workspace);
          is_found = result.pose.has_value();
          if (is_found) found = result.pose->camera_from_object;
        } else {
          for (std::size_t i = 0; i < image.size(); ++i) {
            const auto k = static_cast<Eigen::Index>(i);
            image[i] = {scene.pixels(0, k), scene.pixels(1, k)};
          }
          cv::Vec3d turn;
          cv::Vec3d shift;
          is_found = cv::solvePnP(object, image, matrix, cv::noArray(), turn, shift, false,
                                  cv::SOLVEPNP_SQPNP);
          found = {geometry::rotation_by(geometry::to_eigen(turn)), geometry::to_eigen(shift)};
        }
        times.push_back(
            std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start)
                .count());
        if (!is_found) {
          ++row.failures;
          continue;
        }
        row.rotation_deg += geometry::angle_of(found.rotation * scene.truth.rotation.transpose()) *
                            180 / std::numbers::pi;
        row.translation_mm += (found.translation - scene.truth.translation).norm();
      }
      const int with_pose = std::max(1, options.poses - row.failures);
      row.rotation_deg /= with_pose;
      row.translation_mm /= with_pose;
      const auto half = times.begin() + static_cast<std::ptrdiff_t>(times.size() / 2);
      std::nth_element(times.begin(), half, times.end());
      row.us = *half;
      rows.push_back(row);
    }
  }
  return rows;
}

}  // namespace tarsier::face::head
