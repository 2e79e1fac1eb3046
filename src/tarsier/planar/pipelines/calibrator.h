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
  // Which views of a video are worth taking. still_px is that of an image whose larger side is 640
  // px, and grows with larger ones.
  calibration::CollectorOptions collect;
  int search_px = 800;  // the image's larger side when the board is searched
  // A person moves the board in front of a camera and waits for the answer: the first search that
  // fails is not repeated in other ways; after 15 frames without a board only every third one is
  // searched, in turns as it is and as if it were evenly lit; images of their own are judged as the
  // frames of a video are, and only those with a view are remembered.
  bool live = false;
  double look_every_s = 0.2;  // search(): time between the frames of a video that are looked at, s
  int every = 1;              // search(): so many times fewer of them
  bool keep_images = false;   // the frames of videos whose views were taken

  [[nodiscard]] OptionFields fields() {
    return {{"search_px", search_px, range(160, 4000)},
            {"look_every_s", look_every_s, at_least(0)},
            {"every", every, at_least(1)}};
  }
  void check() const;  // throws std::invalid_argument that names the value
};

// Those that suit a person who moves the board: quick searches (480 px), views of a still board.
[[nodiscard]] CalibratorOptions live_calibrator_options();

// An image or frame that was looked at.
struct CalibrationImage {
  std::string name;
  std::int64_t index = 0;  // of the frame
  double time = 0;         // s
  bool still = true;       // an image of its own, no frame of a video
  bool found = false;      // there is a view of it: CalibrationResult::views[view]
  std::string reason;      // why it does not count; empty: it does
  std::size_t view = 0;
  double ms = 0;  // of the search
  cv::Mat image;  // where images are kept
};

// What one look at an image gave.
struct CalibratorAnswer {
  calibration::BoardView board;  // empty: none is there, or it was not searched this time
  // Empty: the image's size is not that of the ones before it (live).
  std::optional<calibration::Verdict> verdict;
  [[nodiscard]] bool is_taken() const {
    return verdict == calibration::Verdict::kTaken || verdict == calibration::Verdict::kReplaced;
  }
};

// What was seen so far.
struct CalibratorState {
  std::vector<CalibrationImage> images;  // in their order; where `live` those of `views`
  std::vector<calibration::BoardView> views;
  std::vector<cv::Size> sizes;  // px, of the views' images
  cv::Size size;                // px, of the first image
  // Of the video at hand: what is new in it, and for each view of the collector its image.
  std::optional<calibration::ViewCollector> collector;
  std::vector<std::size_t> taken;
  std::string source;
  std::vector<cv::Mat> boardless;  // the first images without the board
  // Of the latest frame.
  Frame frame;
  calibration::BoardView board;
  double sharpness = 0;
  double ms = 0;
  // Of `live`.
  int frames_without = 0;    // since a board was seen
  int searches_without = 0;  // of these
  bool even_light = false;   // how it is searched: calibration::FindOptions
};

struct CalibrationResult {
  calibration::BoardSpec board;
  cv::Size size;  // px, of the camera's images: the size of most views
  std::vector<CalibrationImage> images;
  // An empty one is left out, for its image has another size.
  std::vector<calibration::BoardView> views;
  calibration::Calibration calibration;  // its refusal says why there is no camera
  calibration::Coverage coverage;        // by the views that are used; without a camera by all

  [[nodiscard]] bool ok() const { return calibration.ok(); }
  [[nodiscard]] std::vector<calibration::BoardView> used_views() const;  // without a camera all
};

// {"model", "board", "width", "height", "fx", "fy", "cx", "cy", "distortion", "rms", "deviations",
// "images", "used", "coverage", "missing", "warnings"}: the last line of `tarsier calibrate
// --json` without the file's name. Without a camera {"board", "refusal", "images", "coverage",
// "missing"}.
[[nodiscard]] nlohmann::ordered_json to_json(const CalibrationResult& result);
// {"image"} or {"frame", "time"}, "found", "used", "reason", "points", "dropped", "rms", "tilt",
// "rvec", "tvec" (board to camera, m), "ms": the line of one of result.images.
[[nodiscard]] nlohmann::ordered_json to_json(const CalibrationResult& result,
                                             const CalibrationImage& image);

// Cameras from images, videos or a live view of a board:
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
// Const: any number of threads may use it, each with a state of its own.
class Calibrator {
 public:
  // Throws as CalibratorOptions::check().
  [[nodiscard]] static Calibrator load(const CalibratorOptions& options);

  [[nodiscard]] const CalibratorOptions& options() const { return options_; }

  // Looks for the board in a frame (CV_8UC3 or CV_8UC1) and takes its view where it is worth it: of
  // an image of its own always, of a video where it is sharp and new (calibration/collector.h); a
  // new source begins a new video. Where `live`: see the options.
  CalibratorAnswer process(const Frame& frame, CalibratorState& state) const;
  // All of a source that ends; of videos some frames. Throws Interrupted, and what the source does.
  void search(FrameSource& source, CalibratorState& state, Progress& progress,
              const std::stop_token& stop = {}) const;
  // Takes the view of the latest frame of a `live` state, whatever it is, where there is a board.
  CalibratorAnswer take(CalibratorState& state) const;
  // Forgets the view that was taken last; nothing where there is none.
  void forget_last(CalibratorState& state) const;

  // The camera of most views' images; `start`: see calibration::CalibrateOptions. Throws
  // std::invalid_argument where no image was processed, Interrupted.
  [[nodiscard]] CalibrationResult calibrate(const CalibratorState& state,
                                            const std::optional<geometry::Camera>& start = {},
                                            const std::stop_token& stop = {}) const;
  // Where few images show the board: the inner corners of another chess board that the first ones
  // without it show ("8x6"). Slow (many searches).
  [[nodiscard]] std::optional<std::string> other_board(const CalibratorState& state) const;

 private:
  explicit Calibrator(const CalibratorOptions& options);
  void look(const Frame& frame, CalibratorState& state) const;
  CalibratorAnswer look_live(const Frame& frame, CalibratorState& state) const;
  [[nodiscard]] calibration::ViewCollector collector_for(cv::Size size) const;
  CalibratorAnswer accept(const calibration::ViewCollector::Answer& answer,
                          CalibratorState& state) const;

  CalibratorOptions options_;
};

}  // namespace tarsier::planar
