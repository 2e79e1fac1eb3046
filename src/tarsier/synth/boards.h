// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/planar/calibration/board.h"
#include "tarsier/planar/calibration/detect.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <cstdint>
#include <optional>
#include <vector>

// Printed calibration boards as a known camera sees them.
namespace tarsier::synth {

struct BoardLook {
  double blur_px = 0.6;   // standard deviation of the lens's and the pixels' blur
  double noise = 1.5;     // grey levels
  double paper = 225;     // grey level of white, 0..255
  double ink = 35;        // of black
  double fall_off = 0.2;  // how much darker the light is at one side of the board, 0..1
  int clutter = 0;        // rectangles and disks behind the board
  bool color = true;      // CV_8UC3, else CV_8UC1
  std::uint64_t seed = 1;
};

// The board's printed sheet, black and white: whether a place (m, in the board's frame) is inked;
// `is_sheet` says whether it is on the sheet at all (one square or pitch of rim around the print).
struct BoardPrint {
  explicit BoardPrint(const planar::calibration::BoardSpec& spec);
  [[nodiscard]] bool is_ink(const cv::Point2d& at) const;
  [[nodiscard]] bool is_sheet(const cv::Point2d& at) const;
  // The ink of all places of a box, where they are alike; nothing where they differ, or may.
  [[nodiscard]] std::optional<bool> uniform_ink(const cv::Rect2d& box) const;
  [[nodiscard]] cv::Rect2d sheet() const { return sheet_; }  // m

 private:
  planar::calibration::BoardSpec spec_;
  cv::Rect2d print_;
  cv::Rect2d sheet_;
  std::vector<cv::Mat> markers_;  // charuco: cells with their frame, 1 = white, by number
};

// A camera before a board that moves; knows its rays. Each image depends on the pose and the
// look alone.
class BoardRenderer {
 public:
  BoardRenderer(const geometry::Camera& camera, const planar::calibration::BoardSpec& spec);
  [[nodiscard]] cv::Mat render(const geometry::Rigid3& camera_from_board,
                               const BoardLook& look) const;

 private:
  geometry::Camera camera_;
  BoardPrint print_;
  cv::Mat rays_;  // of the corners of all pixels, CV_64FC2; NaN where there is none
};

// What `camera` sees: each pixel is the mean of 8 x 8 places of the sheet, found through the exact
// lens; then blur, light, noise. The same arguments give the same image.
[[nodiscard]] cv::Mat render_board(const geometry::Camera& camera,
                                   const geometry::Rigid3& camera_from_board,
                                   const planar::calibration::BoardSpec& spec,
                                   const BoardLook& look = {});

// Where the board's points are exactly, those inside the image by `margin_px`. Of dots: the
// projections of their centres (which are not the centres of their images).
[[nodiscard]] planar::calibration::BoardView exact_view(const geometry::Camera& camera,
                                                        const geometry::Rigid3& camera_from_board,
                                                        const planar::calibration::BoardSpec& spec,
                                                        double margin_px = 0);

// A pose with the board's middle at `at` of the image (0..1 each way), turned by the angles
// (degrees: about the vertical, the horizontal and the line of sight), so far away that the board
// takes `share` of the image's smaller side (of its larger extent, for a frontal board).
[[nodiscard]] geometry::Rigid3 board_pose(const geometry::Camera& camera,
                                          const planar::calibration::BoardSpec& spec,
                                          const cv::Point2d& at, const Eigen::Vector3d& angles_deg,
                                          double share);

// `count` poses that together cover the image and tilt the board every way, all points (whole
// dots) of the board inside the image. Throws std::invalid_argument where the camera can not see
// it whole.
[[nodiscard]] std::vector<geometry::Rigid3> board_poses(const geometry::Camera& camera,
                                                        const planar::calibration::BoardSpec& spec,
                                                        int count, std::uint64_t seed);

// A hand that shows a board to a camera: holds it still in one place, moves it to the next, now and
// then takes it away.
class BoardVideo {
 public:
  // A pinhole with some distortion, focal length 0.85 of the width. Throws std::invalid_argument
  // for sizes under 160x120 px.
  BoardVideo(cv::Size size, const planar::calibration::BoardSpec& spec, std::uint64_t seed);
  [[nodiscard]] const geometry::Camera& camera() const { return camera_; }
  // Nothing while the board is away.
  [[nodiscard]] std::optional<geometry::Rigid3> pose_at(double time_s) const;
  [[nodiscard]] cv::Mat image_at(double time_s) const;

 private:
  geometry::Camera camera_;
  planar::calibration::BoardSpec spec_;
  std::vector<geometry::Rigid3> poses_;
  BoardRenderer renderer_;
  std::uint64_t seed_;
};

}  // namespace tarsier::synth
