// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <Eigen/Core>
#include <opencv2/core/matx.hpp>

#include <vector>

namespace tarsier::sfm {

// The tracks of several models as one list of points: those with a feature in common become one, unless that would put two
// features of an image into a track.
class UnitedPoints {
 public:
  // `images`: with the features that tracks name.
  explicit UnitedPoints(const std::vector<Image>& images);
  // `moved`: the position in the common frame; `track`: what counts of its observations.
  void add(const Point& point, const Eigen::Vector3d& moved, std::vector<Observation> track);
  // Those with two observations or more: mean positions and colours, weighted by the observations.
  [[nodiscard]] std::vector<Point> points() const;

 private:
  struct United {
    std::vector<Observation> track;  // by image
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    cv::Vec3d color;
    double weight = 0;
  };

  [[nodiscard]] int& owner_of(const Observation& seen);
  void take(int point, const std::vector<Observation>& track);

  std::vector<std::vector<int>> owner_;  // of each feature: its point, or -1
  std::vector<United> points_;
};

}  // namespace tarsier::sfm
