// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/rigid3.h"

#include <Eigen/Core>

#include <deque>
#include <optional>
#include <vector>

// Smoothing of pose sequences. Rotations are averaged as unit quaternions of equal sign, so that
// angles may pass 180 degrees.
//
// A covariance of the rotation's error (rad^2, see head/angle_sigma.h), if given, is converted to
// that of the smoothed rotation. It is averaged with the same weights as the poses: errors of one
// face in neighbouring frames are similar and do not average out (for fully dependent errors this
// is the upper bound). d d^T is added, where d is the rotation vector by which the smoothed pose
// lags behind the latest one.
namespace tarsier::face::head {

// The chordal mean of rotations (Markley et al., "Averaging quaternions", 2007) and the mean of
// translations. Throws std::invalid_argument for an empty list.
[[nodiscard]] geometry::Rigid3 mean_pose(const std::vector<geometry::Rigid3>& poses);

// Mean of the last `length` poses.
class MeanFilter {
 public:
  explicit MeanFilter(int length = 5);  // 1..1000
  [[nodiscard]] geometry::Rigid3 operator()(const geometry::Rigid3& pose,
                                            Eigen::Matrix3d* rotation_covariance = nullptr);
  void reset() {
    last_.clear();
    covariances_.clear();
  }

 private:
  std::size_t length_;
  std::deque<geometry::Rigid3> last_;
  std::deque<Eigen::Matrix3d> covariances_;
};

// Casiez, Roussel and Vogel, "1 euro filter", CHI 2012: a low pass whose cut-off frequency rises
// with speed: steady at rest, little lag in motion. Rotation and translation have separate filters.
struct OneEuroOptions {
  double rotation_cutoff_hz = 1;  // at rest
  double rotation_beta = 0.05;    // cut-off in Hz per degree/s
  double translation_cutoff_hz = 1;
  double translation_beta = 0.02;  // cut-off in Hz per mm/s
  double speed_cutoff_hz = 1;      // of the speed itself

  [[nodiscard]] OptionFields fields() {
    return {{"rotation_cutoff_hz", rotation_cutoff_hz, above(0)},
            {"rotation_beta", rotation_beta, at_least(0)},
            {"translation_cutoff_hz", translation_cutoff_hz, above(0)},
            {"translation_beta", translation_beta, at_least(0)},
            {"speed_cutoff_hz", speed_cutoff_hz, above(0)}};
  }
  void check() const { check_fields(*this); }
};

class OneEuroFilter {
 public:
  explicit OneEuroFilter(const OneEuroOptions& options = {});
  // `time` in s, rising. A pose at or before the last one's time restarts the filter.
  [[nodiscard]] geometry::Rigid3 operator()(const geometry::Rigid3& pose, double time,
                                            Eigen::Matrix3d* rotation_covariance = nullptr);
  void reset() { is_started_ = false; }

 private:
  OneEuroOptions options_;
  bool is_started_ = false;
  double time_ = 0;
  geometry::Rigid3 raw_;
  geometry::Rigid3 smooth_;
  Eigen::Matrix3d covariance_ = Eigen::Matrix3d::Zero();  // without the lag
  double rotation_speed_ = 0;                             // degrees/s
  Eigen::Vector3d velocity_ = Eigen::Vector3d::Zero();    // mm/s
};

}  // namespace tarsier::face::head
