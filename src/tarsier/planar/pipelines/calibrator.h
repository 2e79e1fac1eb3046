// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/media/frame.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/planar/calibration/calibrate.h"
#include "tarsier/planar/calibration/collector.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::planar {

struct CalibratorOptions {
  calibration::BoardSpec board;
  calibration::CalibrateOptions calibrate;
  // Selects the views of a video that are used. still_px holds for an image whose larger side is
  // 640 px; it is scaled up for larger images.
  calibration::CollectorOptions collect;
  int search_px = 800;  // larger side of the image in which the board is searched, px
  // Live mode, for a person who moves the board in front of a camera and waits for the answer. A
  // search that fails is not repeated with other methods. After 15 frames without a board only
  // every third frame is searched; the search alternates between the plain frame and one with
  // evened light. Stills are judged like the frames of a video. Only images with a view are kept.
  bool live = false;
  double examine_every_s = 0.2;  // search(): time between the examined frames of a video, s
  int every = 1;                 // search(): examines only each n-th of those frames
  bool keep_images = false;      // keeps the frames of videos whose views were taken

  [[nodiscard]] OptionFields fields() {
    return {{"search_px", search_px, range(160, 4000)},
            {"look_every_s", examine_every_s, at_least(0)},
            {"every", every, at_least(1)}};
  }
  void check() const;  // throws std::invalid_argument that names the value
};

// Options for a person who moves the board: fast searches (480 px), and only views of a still
// board.
[[nodiscard]] CalibratorOptions live_calibrator_options();

// An image or frame that was examined.
struct CalibrationImage {
  std::string name;
  std::int64_t index = 0;  // of the frame in its video
  double time = 0;         // s
  bool still = true;       // a single image, not a frame of a video
  bool found = false;      // it has a view: CalibrationResult::views[view]
  std::string reason;      // why the image is not used; empty if it is used
  std::size_t view = 0;
  double ms = 0;  // of the search
  cv::Mat image;  // only if images are kept
};

// The result of one image.
struct CalibratorAnswer {
  calibration::BoardView board;  // empty if there is no board, or if this frame was not searched
  // Empty if the image's size differs from that of the earlier images (live mode).
  std::optional<calibration::ViewDecision> decision;
  [[nodiscard]] bool is_accepted() const {
    return decision == calibration::ViewDecision::kAccepted ||
           decision == calibration::ViewDecision::kReplaced;
  }
};

// The images and views so far.
struct CalibratorState {
  std::vector<CalibrationImage> images;  // in order; in live mode only those of `views`
  std::vector<calibration::BoardView> views;
  std::vector<cv::Size> sizes;  // px, of the images of `views`
  cv::Size size;                // px, of the first image
  // For the current video: the collector of new views, and the image of each of its views.
  std::optional<calibration::ViewCollector> collector;
  std::vector<std::size_t> accepted_images;
  std::string source;
  std::vector<cv::Mat> images_without_board;  // the first images without the board
  // For the latest frame.
  Frame frame;
  calibration::BoardView board;
  double sharpness = 0;
  double ms = 0;
  // For live mode.
  int frames_without_board = 0;    // since a board was last found
  int searches_without_board = 0;  // of these frames, those searched
  bool even_light = false;         // how the next frame is searched: calibration::FindOptions
};

struct CalibrationResult {
  calibration::BoardSpec board;
  cv::Size size;  // px, size of the camera's images: the most frequent size among the views
  std::vector<CalibrationImage> images;
  // An empty view is excluded because its image has another size.
  std::vector<calibration::BoardView> views;
  calibration::Calibration calibration;  // if there is no camera, its refusal gives the reason
  calibration::Coverage coverage;        // of the used views; without a camera, of all views

  [[nodiscard]] bool ok() const { return calibration.ok(); }
  // The views used by the calibration; without a camera, all views.
  [[nodiscard]] std::vector<calibration::BoardView> used_views() const;
};

// {"model", "board", "width", "height", "fx", "fy", "cx", "cy", "distortion", "rms", "deviations",
// "images", "used", "coverage", "missing", "warnings"}: the last line of `tarsier calibrate
// --json`, without the file name. Without a camera: {"board", "refusal", "images", "coverage",
// "missing"}.
[[nodiscard]] nlohmann::ordered_json to_json(const CalibrationResult& result);
// {"image"} or {"frame", "time"}, "found", "used", "reason", "points", "dropped", "rms", "tilt",
// "rvec", "tvec" (board to camera, m), "ms": the line of one image of result.images.
[[nodiscard]] nlohmann::ordered_json to_json(const CalibrationResult& result,
                                             const CalibrationImage& image);

// Calibrates cameras from images, videos or a live view of a board:
//
//   planar::CalibratorOptions options;
//   options.board = planar::calibration::parse_board("chess:9x6", 0.025);
//   const auto calibrator = planar::Calibrator::load(options);
//   planar::CalibratorState state;
//   NoProgress progress;
//   calibrator.search(*open_source("board.mp4"), state, progress);  // or process() each frame
//   const planar::CalibrationResult result = calibrator.calibrate(state);
//   if (result.ok())
//     geometry::write_camera_file("camera.yaml", result.calibration.camera);
//   else
//     fmt::print("{}\n", result.calibration.refusal);
//
// The object is const. Any number of threads may use it, each with its own state.
class Calibrator {
 public:
  // Throws the same exceptions as CalibratorOptions::check().
  [[nodiscard]] static Calibrator load(const CalibratorOptions& options);

  [[nodiscard]] const CalibratorOptions& options() const { return options_; }

  // Searches the board in a frame (CV_8UC3 or CV_8UC1) and keeps its view if it is useful. The view
  // of a single image is always kept; that of a video only if it is sharp and new
  // (calibration/collector.h). A new source starts a new video. Live mode differs: see
  // CalibratorOptions::live.
  CalibratorAnswer process(const Frame& frame, CalibratorState& state) const;
  // Processes a source to its end; of videos only some frames. Throws Interrupted and the
  // exceptions of the source.
  void search(FrameSource& source, CalibratorState& state, Progress& progress,
              const std::stop_token& stop = {}) const;
  // Keeps the view of the latest frame without judging it, if the frame shows a board. Live mode
  // only.
  CalibratorAnswer take(CalibratorState& state) const;
  // Removes the view that was kept last, if there is one.
  void forget_last(CalibratorState& state) const;

  // Calibrates the camera whose image size is the most frequent one. `start`: see
  // calibration::CalibrateOptions. Throws std::invalid_argument if no image was processed, and
  // Interrupted.
  [[nodiscard]] CalibrationResult calibrate(const CalibratorState& state,
                                            const std::optional<geometry::Camera>& start = {},
                                            const std::stop_token& stop = {}) const;
  // For the case that few images show the board: finds the inner corners ("8x6") of another chess
  // board in the first images without the board. Slow (many searches).
  [[nodiscard]] std::optional<std::string> other_board(const CalibratorState& state) const;

 private:
  explicit Calibrator(const CalibratorOptions& options);
  void find_board_in(const Frame& frame, CalibratorState& state) const;
  CalibratorAnswer process_live(const Frame& frame, CalibratorState& state) const;
  [[nodiscard]] calibration::ViewCollector collector_for(cv::Size size) const;
  CalibratorAnswer accept(const calibration::ViewCollector::Answer& answer,
                          CalibratorState& state) const;

  CalibratorOptions options_;
};

}  // namespace tarsier::planar
