// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/absolute_pose.h"

#include "tarsier/geometry/opencv_types.h"

#include <opencv2/calib3d.hpp>

namespace tarsier::sfm {

std::optional<geometry::Rigid3> absolute_pose(const std::vector<cv::Point3d>& positions,
                                              const std::vector<cv::Point2d>& pixels,
                                              const geometry::Camera& camera, double max_error_px,
                                              std::uint64_t seed) {
  cv::UsacParams params;
  params.confidence = 0.9999;
  params.isParallel = false;
  params.loIterations = 10;
  params.loMethod = cv::LOCAL_OPTIM_INNER_LO;
  params.loSampleSize = 14;
  params.maxIterations = 10000;
  params.neighborsSearch = cv::NEIGH_GRID;
  params.randomGeneratorState = static_cast<int>(seed & 0x7fffffffU);
  params.sampler = cv::SAMPLING_UNIFORM;
  params.score = cv::SCORE_METHOD_MSAC;
  params.threshold = max_error_px;
  cv::Mat matrix(camera.matrix());
  cv::Vec3d rotation_vector;
  cv::Vec3d translation;
  cv::Mat inliers;
  try {
    if (!cv::solvePnPRansac(positions, pixels, matrix, cv::noArray(), rotation_vector, translation,
                            inliers, params)) {
      return std::nullopt;
    }
  } catch (const cv::Exception&) {
    return std::nullopt;
  }
  const geometry::Rigid3 pose{geometry::rotation_by(geometry::to_eigen(rotation_vector)),
                              geometry::to_eigen(translation)};
  if (!pose.translation.allFinite() || !geometry::is_rotation(pose.rotation)) return std::nullopt;
  return pose;
}

}  // namespace tarsier::sfm
