// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <cstdint>
#include <string>
#include <vector>

// A reconstruction: cameras, images with poses, and points that two or more images see.
namespace tarsier::sfm {

struct Observation {
  int image = 0;    // index into Model::images
  int feature = 0;  // index into Image::features
  friend bool operator==(const Observation&, const Observation&) = default;
};

struct Point {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // world
  cv::Vec3b color;                                     // BGR
  double error = 0;                // px, root mean square reprojection error of its observations
  std::vector<Observation> track;  // two or more, of different images
};

struct Image {
  std::string name;  // relative to the folder of images
  int camera = 0;    // index into Model::cameras
  bool registered = false;
  geometry::Rigid3 pose;              // camera_from_world; valid where registered
  std::vector<cv::Point2f> features;  // px, pixel centres at integers
  std::vector<float> sizes;           // px, diameter of each feature; empty: all equal
  std::vector<int> points;            // for each feature: index into Model::points, or -1
  // Clockwise quarter turns that bring its pixels upright, 0..3 (sensor_image.h); 0 also means
  // unknown.
  int turns = 0;
};

struct Model {
  std::vector<geometry::Camera> cameras;
  std::vector<Image> images;
  std::vector<Point> points;
};

}  // namespace tarsier::sfm
