// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <Eigen/Core>
#include <opencv2/core/matx.hpp>

#include <vector>

namespace tarsier::sfm {

// Merges the tracks of several models into one list of points. Points with a feature in common
// become one, unless two features of an image would then be in a track.
class MergedPoints {
 public:
  // `images` have the features that tracks refer to.
  explicit MergedPoints(const std::vector<Image>& images);
  // `moved`: the position in the common frame; `track`: the observations to use.
  void add(const Point& point, const Eigen::Vector3d& moved, std::vector<Observation> track);
  // The points with two observations or more. Positions and colours are means weighted by
  // observations.
  [[nodiscard]] std::vector<Point> points() const;

 private:
  struct MergedPoint {
    std::vector<Observation> track;  // sorted by image
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    cv::Vec3d color;
    double weight = 0;
  };

  [[nodiscard]] int& owner_of(const Observation& seen);
  void assign(int point, const std::vector<Observation>& track);

  std::vector<std::vector<int>> owner_;  // for each feature: its point, or -1
  std::vector<MergedPoint> points_;
};

}  // namespace tarsier::sfm
