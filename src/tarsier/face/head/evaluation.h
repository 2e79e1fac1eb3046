// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/head/angles.h"
#include "tarsier/face/head/head_model.h"

#include <Eigen/Core>
#include <opencv2/core/types.hpp>

#include <map>
#include <optional>
#include <string>
#include <vector>

// Evaluation of head poses.
namespace tarsier::face::head {

// How often the error is within the predicted standard deviation. For Gaussian errors and correct
// deviations: 68.3 % within one, 95.4 % within two.
struct SigmaCoverage {
  int count = 0;
  int within = 0;   // within one standard deviation
  int within2 = 0;  // within two
  void add(double error_deg, double sigma_deg);
};
struct AngleCoverage {
  SigmaCoverage yaw;
  SigmaCoverage pitch;
  SigmaCoverage roll;
};

// Distance of the mean head from 3D landmarks in a file (point_file.h), after the best similarity,
// in the head's mm.
struct HeadComparison {
  double all_mm = 0;
  double inner_mm = 0;  // points 17..67 of the 68; 0 for other markups
};
// Throws InputError for another number of points, otherwise as read_landmarks3d().
[[nodiscard]] HeadComparison compare_head(const HeadModel& head, const std::string& path);

// --- exact ground truth ---

struct PosePair {
  std::string image;
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Zero();  // estimated camera_from_head
  Eigen::Matrix3d truth = Eigen::Matrix3d::Zero();
  std::optional<Eigen::Vector3d> translation;  // mm, both or none
  std::optional<Eigen::Vector3d> true_translation;
  std::optional<Eigen::Vector3d> sigma_deg;        // of the estimated yaw, pitch, roll
  std::optional<Eigen::Vector3d> sigma_floor_deg;  // the part of it that is a floor (HeadPose)
};

// Angles for comparison with other work (BIWI): R = Rz(roll) Rx(pitch) Ry(yaw); this pitch has the
// opposite sign of HeadAngles.
struct PoseScore {
  int truths = 0;
  int with_pose = 0;
  double pitch_mae_deg = 0;
  double yaw_mae_deg = 0;
  double roll_mae_deg = 0;
  double mean_deg = 0;  // angle of R R_true^T
  double median_deg = 0;
  double p95_deg = 0;      // 95th percentile, interpolated between ranks
  double over_10_deg = 0;  // share of errors of more than 10 degrees
  int with_translation = 0;
  double translation_mean_mm = 0;
  double translation_median_mm = 0;
  double translation_percent = 0;  // mean, % of the distance
  AngleCoverage coverage;          // of the pairs with standard deviations
  AngleCoverage image_coverage;    // of sqrt(sigma^2 - floor^2), of the pairs with a floor
};
[[nodiscard]] PoseScore score_poses(const std::vector<PosePair>& pairs, int truths);

// A line {"image", "rotation": [9]} or "R": [9], {"image", "euler": [pitch, yaw, roll]} (BIWI,
// degrees) or {"image", "yaw", "pitch", "roll"} (HeadAngles). Optionally "translation" or "t", and
// "yaw_sigma_deg", "pitch_sigma_deg", "roll_sigma_deg" and "sigma_floor_deg": [3]. Of {"image",
// "faces": [..]} the first face is used. A line without a pose means that no face was found.
struct PoseLine {
  std::string image;
  std::optional<Eigen::Matrix3d> rotation;
  std::optional<Eigen::Vector3d> translation;
  std::optional<Eigen::Vector3d> sigma_deg;  // of yaw, pitch, roll; set if all three are given
  std::optional<Eigen::Vector3d> sigma_floor_deg;
};
// Throws InputError with path and line: no JSON, no "image", a matrix that is not a rotation
// (1e-3), numbers that are not finite, a negative deviation.
[[nodiscard]] std::vector<PoseLine> read_pose_lines(const std::string& path);

// Pairs of the same "image"; of several lines for an image the last is used.
[[nodiscard]] std::vector<PosePair> match_poses(const std::vector<PoseLine>& found,
                                                const std::vector<PoseLine>& truth);

// --- Pointing'04 (Gourier, Hall and Crowley 2004): file names contain the angles ---

// "person01246-30+15.jpg": person 01, series 2, number 46, tilt -30, pan +15 degrees.
struct PointingName {
  int person = 0;
  double tilt_deg = 0;  // + up
  double pan_deg = 0;   // + towards image left
};
[[nodiscard]] std::optional<PointingName> parse_pointing_name(const std::string& path);

struct PointingOutcome {
  std::string image;
  PointingName truth;
  bool face_detected = false;  // the strict face detector detects a face in the head's box
  std::optional<Eigen::Matrix3d> rotation;   // estimated camera_from_head of that head
  std::optional<Eigen::Vector3d> sigma_deg;  // of its yaw, pitch, roll
};

// The direction in which a head looks: azimuth (+ to image left) and elevation (+ up) of its
// forward direction, R (0, 0, -1) = (-sin azimuth cos elevation, -sin elevation, -cos azimuth cos
// elevation). The set's pan and tilt are these angles. Yaw and pitch are different: a head that
// pans by 45 degrees and then nods by 30 has a pitch of 21 and a roll of 22 degrees.
struct Gaze {
  double azimuth_deg = 0;
  double elevation_deg = 0;
};
[[nodiscard]] Gaze gaze_of_rotation(const Eigen::Matrix3d& camera_from_head);
[[nodiscard]] Eigen::Vector3d forward_of_gaze(const Gaze& gaze);
// Yaw and pitch of the head that looks along the unit vector `forward` and has this roll. With the
// roll removed, the forward direction is (-sin yaw, -sin pitch cos yaw, -cos pitch cos yaw).
[[nodiscard]] HeadAngles angles_towards(const Eigen::Vector3d& forward, double roll_deg);

struct PointingScore {
  int images = 0;              // |pan| <= 45, |tilt| <= 30
  int detected = 0;            // by the strict face detector
  int detected_with_pose = 0;  // of those with a pose
  int with_pose = 0;  // with a pose, including faces that only a less strict search detected
  // Mean absolute error after subtracting the median error, because people do not look exactly
  // where the set says.
  double yaw_mae_deg = 0;
  double pitch_mae_deg = 0;
  double yaw_offset_deg = 0;
  double pitch_offset_deg = 0;
  double yaw_mae_raw_deg = 0;  // without offsets
  double pitch_mae_raw_deg = 0;
  // Error of the elevation against the tilt, without the offset.
  double elevation_mae_deg = 0;
  // Error of the azimuth against the pan, without the offset.
  double azimuth_mae_deg = 0;
  std::map<double, double> yaw_of_pan;     // mean yaw of each pan
  std::map<double, double> pitch_of_tilt;  // mean pitch of each tilt
  bool yaw_rises = false;                  // strictly with pan
  // Yaw and pitch are compared with those of a head that looks where the name says and has the
  // estimated roll (angles_towards); offsets are not subtracted. The true roll is unknown.
  AngleCoverage coverage;
};
[[nodiscard]] PointingScore score_pointing(const std::vector<PointingOutcome>& outcomes);

// The annotated face of a Pointing'04 image, from the .txt file in the same folder ("Face", then
// centre x, centre y, width, height); empty if there is none.
[[nodiscard]] std::optional<cv::Rect2d> pointing_box(const std::string& image);

}  // namespace tarsier::face::head
