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

// Synthetic views of printed calibration boards by a known camera.
namespace tarsier::synth {

struct BoardAppearance {
  double blur_px = 0.6;   // standard deviation of the blur of lens and pixels
  double noise = 1.5;     // grey levels
  double paper = 225;     // grey level of white, 0..255
  double ink = 35;        // grey level of black
  double fall_off = 0.2;  // relative decrease of the light towards one side of the board, 0..1
  int clutter = 0;        // number of rectangles and disks behind the board
  bool color = true;      // CV_8UC3, else CV_8UC1
  std::uint64_t seed = 1;
};

// The board's printed sheet, black and white. Positions are in m, in the board's frame. The sheet
// has a margin of one square or pitch around the print.
struct BoardPrint {
  explicit BoardPrint(const planar::calibration::BoardSpec& spec);
  [[nodiscard]] bool is_ink(const cv::Point2d& at) const;
  [[nodiscard]] bool is_sheet(const cv::Point2d& at) const;
  // The ink of a box if it is uniform; empty if it is not, or may not be.
  [[nodiscard]] std::optional<bool> uniform_ink(const cv::Rect2d& box) const;
  [[nodiscard]] cv::Rect2d sheet() const { return sheet_; }  // m

 private:
  planar::calibration::BoardSpec spec_;
  cv::Rect2d print_;
  cv::Rect2d sheet_;
  std::vector<cv::Mat> markers_;  // charuco: cells with their frame, 1 = white, by marker number
};

// Renders a moving board for one camera; keeps the rays of its pixels. Each image depends only on
// the pose and the look.
class BoardRenderer {
 public:
  BoardRenderer(const geometry::Camera& camera, const planar::calibration::BoardSpec& spec);
  [[nodiscard]] cv::Mat render(const geometry::Rigid3& camera_from_board,
                               const BoardAppearance& appearance) const;

 private:
  geometry::Camera camera_;
  BoardPrint print_;
  cv::Mat rays_;  // of the corners of all pixels, CV_64FC2; NaN if a pixel has no ray
};

// Renders the view of `camera`. Each pixel is the mean of 8 x 8 samples of the sheet, found through
// the exact lens; then blur, light and noise are added. The same arguments give the same image.
[[nodiscard]] cv::Mat render_board(const geometry::Camera& camera,
                                   const geometry::Rigid3& camera_from_board,
                                   const planar::calibration::BoardSpec& spec,
                                   const BoardAppearance& appearance = {});

// The exact positions of the board's points that are inside the image by `margin_px`. For dots
// these are the projections of their centres (which are not the centres of their images).
[[nodiscard]] planar::calibration::BoardView exact_view(const geometry::Camera& camera,
                                                        const geometry::Rigid3& camera_from_board,
                                                        const planar::calibration::BoardSpec& spec,
                                                        double margin_px = 0);

// A pose with the board's centre at `at` of the image (0..1 in each direction), rotated by the
// angles (degrees: about the vertical, the horizontal and the line of sight). Its distance is such
// that a frontal board takes `share` of the image's smaller side with its larger extent.
[[nodiscard]] geometry::Rigid3 board_pose(const geometry::Camera& camera,
                                          const planar::calibration::BoardSpec& spec,
                                          const cv::Point2d& at, const Eigen::Vector3d& angles_deg,
                                          double share);

// `count` poses that together cover the image and tilt the board in all directions, with all points
// (whole dots) inside the image. Throws std::invalid_argument if the camera cannot see the whole
// board.
[[nodiscard]] std::vector<geometry::Rigid3> board_poses(const geometry::Camera& camera,
                                                        const planar::calibration::BoardSpec& spec,
                                                        int count, std::uint64_t seed);

// A simulated hand that shows a board to a camera: it holds the board still, moves it to the next
// position, and sometimes takes it away.
class BoardVideo {
 public:
  // Uses a pinhole camera with some distortion and a focal length of 0.85 of the width. Throws
  // std::invalid_argument for sizes below 160x120 px.
  BoardVideo(cv::Size size, const planar::calibration::BoardSpec& spec, std::uint64_t seed);
  [[nodiscard]] const geometry::Camera& camera() const { return camera_; }
  // Empty while the board is away.
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
