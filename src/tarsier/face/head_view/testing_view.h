// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/face/head/head_model.h"
#include "tarsier/face/head_view/head_view.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"

#include <Eigen/Core>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <optional>
#include <vector>

// A synthetic head that can be seen from all sides, for tests: a sphere with painted spots.
namespace tarsier::face::head_view {

inline geometry::Camera testing_camera() {
  geometry::Camera camera;
  camera.width = 320;
  camera.height = 240;
  camera.fx = camera.fy = 420;
  camera.cx = 159.5;
  camera.cy = 119.5;
  return camera;
}

// Spots at fixed positions on a ball around the centre of the head, symmetric left and right.
inline cv::Mat painted_head(const geometry::Rigid3& camera_from_head,
                            const geometry::Camera& camera) {
  cv::Mat gray(camera.height, camera.width, CV_8UC1, cv::Scalar(70));
  const Eigen::Vector3d center(0, 30, 40);
  const double radius = 80;
  const double px_per_mm = camera.fx / (camera_from_head * center)[2];
  const auto at = [&](const Eigen::Vector3d& point) {
    const cv::Point2d p = *camera.project(camera_from_head * point);
    return cv::Point(cvRound(p.x * 16), cvRound(p.y * 16));
  };
  const auto disc = [&](const Eigen::Vector3d& point, double mm, int brightness) {
    cv::circle(gray, at(point), cvRound(mm * px_per_mm * 16), cv::Scalar(brightness), cv::FILLED,
               cv::LINE_AA, 4);
  };
  disc(center, radius, 180);
  const double spots[][2] = {{0, -5}, {25, 20}, {-25, 20}, {20, -35}, {-20, -35},
                             {0, 50}, {60, 10}, {-60, 10}, {50, -40}, {-50, -40}};
  for (const auto& spot : spots) {
    const double yaw = spot[0] * CV_PI / 180;
    const double pitch = spot[1] * CV_PI / 180;
    const Eigen::Vector3d out(std::sin(yaw) * std::cos(pitch), -std::sin(pitch),
                              -std::cos(yaw) * std::cos(pitch));
    if ((camera_from_head.rotation * out)[2] > -0.2) continue;  // on the far side
    disc(center + radius * out, 9, 40);
  }
  return gray;
}

// Four landmarks on that ball: two eyes, the nose, the chin.
inline head::HeadModel testing_points() {
  head::HeadModel head;
  head.mean.resize(3, 4);
  head.mean << -30, 30, 0, 0,  //
      0, 0, 40, 90,            //
      -20, -20, -40, -10;
  head.mirror = {1, 0, 2, 3};
  return head;
}

inline Eigen::Matrix2Xd projected_points(const geometry::Rigid3& camera_from_head,
                                         const geometry::Camera& camera) {
  const head::HeadModel head = testing_points();
  Eigen::Matrix2Xd points(2, head.points());
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const auto pixel = camera.project(camera_from_head * Eigen::Vector3d(head.mean.col(i)));
    points.col(i) << pixel->x, pixel->y;
  }
  return points;
}

// The view of an image with exact landmarks: those of `truth`, or of the approximate pose if null.
inline std::optional<HeadView> view_of_painted(const cv::Mat& image, const geometry::Camera& camera,
                                               const geometry::Rigid3& rough,
                                               const geometry::Rigid3* truth = nullptr) {
  return view_of_head(image, camera, rough, testing_points(),
                      projected_points(truth != nullptr ? *truth : rough, camera));
}

}  // namespace tarsier::face::head_view
