// SPDX-License-Identifier: MIT
#include "tarsier/face/head/smoothing.h"

#include "tarsier/core/require.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/linalg/decompositions.h"

#include <Eigen/Core>

#include <cmath>
#include <numbers>

namespace tarsier::face::head {
namespace {

// Weight of the new value in a first-order low pass.
double share(double cutoff_hz, double seconds) {
  const double r = 2 * std::numbers::pi * cutoff_hz * seconds;
  return r / (1 + r);
}

Eigen::Matrix3d with_lag(const Eigen::Matrix3d& covariance, const geometry::Rigid3& smooth,
                         const geometry::Rigid3& latest) {
  const Eigen::Vector3d lag =
      geometry::rotation_vector(smooth.rotation * latest.rotation.transpose());
  return covariance + lag * lag.transpose();
}

}  // namespace

geometry::Rigid3 mean_pose(const std::vector<geometry::Rigid3>& poses) {
  TARSIER_REQUIRE(!poses.empty(), "no poses");
  Eigen::Matrix4d sum = Eigen::Matrix4d::Zero();
  geometry::Rigid3 mean;
  for (const geometry::Rigid3& pose : poses) {
    const Eigen::Vector4d q = geometry::quaternion_of(pose.rotation);
    sum += q * q.transpose();
    mean.translation += pose.translation * (1.0 / static_cast<double>(poses.size()));
  }
  mean.rotation = geometry::rotation_of(linalg::symmetric_eigen(sum).vectors.col(3));
  return mean;
}

MeanFilter::MeanFilter(int length) : length_(static_cast<std::size_t>(length)) {
  TARSIER_REQUIRE(length >= 1 && length <= 1000, "length {}", length);
}

geometry::Rigid3 MeanFilter::operator()(const geometry::Rigid3& pose,
                                        Eigen::Matrix3d* rotation_covariance) {
  last_.push_back(pose);
  if (last_.size() > length_) last_.pop_front();
  geometry::Rigid3 mean = mean_pose({last_.begin(), last_.end()});
  if (rotation_covariance != nullptr) {
    covariances_.push_back(*rotation_covariance);
    if (covariances_.size() > length_) covariances_.pop_front();
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (const Eigen::Matrix3d& covariance : covariances_) sum += covariance;
    *rotation_covariance = with_lag(sum / static_cast<double>(covariances_.size()), mean, pose);
  }
  return mean;
}

OneEuroFilter::OneEuroFilter(const OneEuroOptions& options) : options_(options) {
  options_.check();
}

geometry::Rigid3 OneEuroFilter::operator()(const geometry::Rigid3& pose, double time,
                                           Eigen::Matrix3d* rotation_covariance) {
  const double seconds = time - time_;
  if (!is_started_ || !(seconds > 0)) {
    is_started_ = true;
    time_ = time;
    raw_ = smooth_ = pose;
    rotation_speed_ = 0;
    velocity_.setZero();
    if (rotation_covariance != nullptr) covariance_ = *rotation_covariance;
    return pose;
  }
  const double of_speed = share(options_.speed_cutoff_hz, seconds);
  const double turned =
      geometry::angle_of(pose.rotation * raw_.rotation.transpose()) * 180 / std::numbers::pi;
  rotation_speed_ += of_speed * (turned / seconds - rotation_speed_);
  velocity_ += of_speed * ((pose.translation - raw_.translation) * (1 / seconds) - velocity_);
  const double of_rotation =
      share(options_.rotation_cutoff_hz + options_.rotation_beta * rotation_speed_, seconds);
  const double of_shift =
      share(options_.translation_cutoff_hz + options_.translation_beta * velocity_.norm(), seconds);
  smooth_.rotation = geometry::interpolate(smooth_.rotation, pose.rotation, of_rotation);
  smooth_.translation += of_shift * (pose.translation - smooth_.translation);
  if (rotation_covariance != nullptr) {
    covariance_ += of_rotation * (*rotation_covariance - covariance_);
    *rotation_covariance = with_lag(covariance_, smooth_, pose);
  }
  raw_ = pose;
  time_ = time;
  return smooth_;
}

}  // namespace tarsier::face::head
